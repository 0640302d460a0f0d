//! Leaving work as soon as the user asks a run to stop.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Time between two looks at the flag that stops a run.
const LOOK: Duration = Duration::from_millis(50);

/// Sets a flag when it is dropped.
struct SetAtEnd<'a>(&'a AtomicBool);

impl Drop for SetAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Works, with `halt` set as soon as `stop` is set; afterwards `halt` is not set.
pub(crate) fn halted_on<T>(stop: &AtomicBool, halt: &AtomicBool, work: impl FnOnce() -> T) -> T {
    let done = AtomicBool::new(false);
    let outcome = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                if stop.load(Ordering::Relaxed) {
                    halt.store(true, Ordering::Relaxed);
                }
                std::thread::sleep(LOOK);
            }
        });
        let _end = SetAtEnd(&done);
        work()
    });
    halt.store(false, Ordering::Relaxed);
    outcome
}
