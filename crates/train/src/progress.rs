//! The display of a run's progress.

use std::io::Write;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::{Deserialize, Serialize};

use crate::rollout::Counting;

/// State of a run, for a display of its progress.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Training episodes so far.
    pub episodes: u64,
    /// Training episodes in all.
    pub total: u64,
    /// Success rate of the last noise-free training episodes.
    pub recent_success: Option<f64>,
    /// Success rate of the last evaluation.
    pub evaluated: Option<f64>,
    /// Postures in the database.
    pub postures: u64,
    /// Sum of the contribution rates.
    pub contribution_sum: Option<f64>,
    /// Environment steps a second, over the last cycles.
    pub steps_per_s: f64,
    /// Episodes that diverged.
    pub diverged: u64,
}

impl Status {
    /// Writes the state as a line of [`Lines`], with the time left if it is known.
    fn plain(&self, left: Option<f64>) -> String {
        let left = left.map_or_else(|| "-".to_owned(), clock);
        format!("episode {}/{}, {left} left: {}", self.episodes, self.total, self.line())
    }

    fn line(&self) -> String {
        let percent = |rate: Option<f64>| rate.map_or_else(|| "-".to_owned(), |r| format!("{:.0} %", 100.0 * r));
        let mut line = format!(
            "success {} in training, {} evaluated, postures {}, contribution {}, {:.0} steps/s",
            percent(self.recent_success),
            percent(self.evaluated),
            self.postures,
            self.contribution_sum.map_or_else(|| "-".to_owned(), |sum| format!("{sum:.3}")),
            self.steps_per_s,
        );
        if self.diverged > 0 {
            line.push_str(&format!(", diverged {}", self.diverged));
        }
        line
    }
}

/// `3725` => `62:05`
fn clock(seconds: f64) -> String {
    let seconds = seconds.round() as u64;
    format!("{}:{:02}", seconds / 60, seconds % 60)
}

/// Writes a line to standard error. A reader that is gone, or a full disk, ends nothing: what is said is no part of the work.
///
/// ```
/// eigenhand_train::say!("episode {}", 3);
/// ```
#[macro_export]
macro_rules! say {
    () => { $crate::say!("") };
    ($($part:tt)*) => { $crate::write_line(format_args!($($part)*)) };
}

/// Writes a line to standard error for [`say!`](crate::say).
#[doc(hidden)]
pub fn write_line(line: std::fmt::Arguments<'_>) {
    let mut out = std::io::stderr().lock();
    let _ = writeln!(out, "{line}");
}

/// A display of progress.
pub trait Progress {
    /// Shows the current state; called at least once a cycle.
    fn update(&mut self, status: &Status);
    /// Shows a line that stays.
    fn note(&mut self, line: &str);
    /// Shows that something was lost or damaged.
    fn warn(&mut self, line: &str) {
        self.note(line);
    }
    /// Returns what shows the episodes of evaluations while they are simulated; none if nothing does.
    fn counting(&mut self) -> Option<Counting> {
        None
    }
    /// Ends the display.
    fn finish(&mut self) {}
}

/// A bar, for a terminal.
pub struct Bar {
    bar: ProgressBar,
}

impl Bar {
    /// Starts a bar on standard error.
    pub fn new() -> Bar {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(4));
        let template = "{elapsed_precise} {bar:24.cyan/dim} {pos}/{len} episodes, {eta} left\n{msg}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        Bar { bar }
    }

    /// Starts a bar for the episodes of evaluations, each of which takes the place of the one before.
    fn of_evaluations() -> ProgressBar {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(4));
        if let Ok(style) = ProgressStyle::with_template("{bar:16.cyan/dim} {pos}/{len} episodes, {eta} left") {
            bar.set_style(style);
        }
        bar
    }
}

impl Default for Bar {
    fn default() -> Self {
        Bar::new()
    }
}

impl Progress for Bar {
    fn update(&mut self, status: &Status) {
        if self.bar.length() != Some(status.total) {
            self.bar.set_length(status.total);
            self.bar.set_position(status.episodes);
            // The time left is estimated from here on, without the episodes before a resumed run.
            self.bar.reset_eta();
        }
        self.bar.set_position(status.episodes);
        self.bar.set_message(status.line());
    }

    fn note(&mut self, line: &str) {
        self.bar.suspend(|| say!("{line}"));
    }

    fn counting(&mut self) -> Option<Counting> {
        let bar = Bar::of_evaluations();
        self.bar = bar.clone();
        Some(Arc::new(move |done, all| {
            if done == 0 {
                bar.set_length(all as u64);
                bar.reset();
            }
            if done < all {
                bar.set_position(done as u64);
            } else {
                bar.finish_and_clear();
            }
        }))
    }

    fn finish(&mut self) {
        // The bar keeps its position, because the run may have been interrupted.
        self.bar.abandon();
        say!();
    }
}

/// Plain lines on standard error, for a log or a pipe.
pub struct Lines {
    started: Option<(Instant, u64)>,
    shown: Option<Instant>,
    every: Duration,
}

impl Lines {
    /// Shows a line at most once in `every`.
    pub fn new(every: Duration) -> Lines {
        Lines { started: None, shown: None, every }
    }
}

impl Progress for Lines {
    fn update(&mut self, status: &Status) {
        let now = Instant::now();
        let (started, first) = *self.started.get_or_insert((now, status.episodes));
        if self.shown.is_some_and(|shown| now - shown < self.every) && status.episodes < status.total {
            return;
        }
        self.shown = Some(now);
        let done = status.episodes.saturating_sub(first);
        let each = (now - started).as_secs_f64() / done as f64;
        let left = (done > 0).then(|| each * status.total.saturating_sub(status.episodes) as f64);
        say!("{}", status.plain(left));
    }

    fn note(&mut self, line: &str) {
        say!("{line}");
    }

    fn counting(&mut self) -> Option<Counting> {
        let (every, shown) = (self.every, Mutex::new(Instant::now()));
        Some(Arc::new(move |done, all| {
            let mut shown = shown.lock().unwrap_or_else(PoisonError::into_inner);
            if done < all && shown.elapsed() >= every {
                *shown = Instant::now();
                say!("evaluation: {done} of {all} episodes");
            }
        }))
    }
}

/// Shows nothing.
pub struct Silent;

impl Progress for Silent {
    fn update(&mut self, _status: &Status) {}
    fn note(&mut self, _line: &str) {}
}

/// Shows what was lost or damaged, and nothing else.
pub struct Quiet;

impl Progress for Quiet {
    fn update(&mut self, _status: &Status) {}
    fn note(&mut self, _line: &str) {}
    fn warn(&mut self, line: &str) {
        say!("note: {line}");
    }
}
