//! Runs the library of a plugin in a process of its own, so that a plugin that exits, crashes or never ends harms itself alone.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

use eigenhand_files::read_regular;

use super::library::{self, MAX_TOTAL, RawFile};
use crate::error::HandError;

/// First argument of a process that runs a plugin; the library and the directory of the exchange follow.
const ARGUMENT: &str = "run-plugin-library";
/// Files of the exchange: the plugin's options, and what came of them.
const OPTIONS: &str = "options";
const RESULT: &str = "result";
/// First byte of the result.
const GENERATED: u8 = b'g';
const FAILED: u8 = b'f';
/// Environment variable: seconds after which a plugin is ended.
const SECONDS: &str = "EIGENHAND_PLUGIN_SECONDS";
const DEFAULT_SECONDS: f64 = 60.0;
const PAUSE: Duration = Duration::from_millis(5);
/// Bytes that names and lengths may need beside the files.
const BESIDE: u64 = 1 << 20;

/// Whether this program runs plugins in processes of its own.
static SERVES: AtomicBool = AtomicBool::new(false);

/// Lets compiled plugins run in processes of their own, which are this program again. A program calls this first in `main`; in
/// such a process, the call runs the plugin and ends the process. Without the call, plugins run in the process that loads them.
pub fn serve_plugins() {
    let mut arguments = std::env::args_os().skip(1);
    if arguments.next().as_deref() == Some(OsStr::new(ARGUMENT))
        && let (Some(library), Some(exchange)) = (arguments.next(), arguments.next())
    {
        std::process::exit(i32::from(serve(Path::new(&library), Path::new(&exchange)).is_err()));
    }
    SERVES.store(true, Ordering::Relaxed);
}

fn serve(library: &Path, exchange: &Path) -> std::io::Result<()> {
    let options = fs::read_to_string(exchange.join(OPTIONS))?;
    let mut result = Vec::new();
    match library::generate(library, &options) {
        Ok(files) => {
            result.push(GENERATED);
            for part in files.iter().flat_map(|(name, content)| [name, content]) {
                result.extend((part.len() as u64).to_le_bytes());
                result.extend(part);
            }
        }
        Err(error) => {
            result.push(FAILED);
            result.extend(error.to_string().as_bytes());
        }
    }
    let partial = exchange.join("partial");
    fs::write(&partial, result)?;
    fs::rename(partial, exchange.join(RESULT))
}

/// Returns the files that `library`, an absolute path, generates from `options`.
pub(super) fn generate(library: &Path, options: &str) -> Result<Vec<RawFile>, HandError> {
    if !SERVES.load(Ordering::Relaxed) {
        return library::generate(library, options);
    }
    let exchange = Exchange::create()?;
    let file = exchange.path.join(OPTIONS);
    fs::write(&file, options).map_err(HandError::io(&file))?;
    let ended = run(library, &exchange.path)?;
    let path = exchange.path.join(RESULT);
    let result = match read_regular(&path, MAX_TOTAL as u64 + BESIDE) {
        Ok(result) => result,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let got = ended.map_or_else(|| "none".to_owned(), |status| format!("none: its process ended ({status})"));
            let expected = format!("a hand within {} s", limit().as_secs_f64());
            return Err(HandError::plugin(library, "the library", &expected, got));
        }
        Err(error) => return Err(HandError::io(&path)(error)),
    };
    match result.split_first() {
        Some((&GENERATED, rest)) => {
            files(rest).ok_or_else(|| HandError::plugin(library, "the library", "whole files", "a part of them"))
        }
        Some((_, message)) => Err(HandError::InPlugin { message: String::from_utf8_lossy(message).into_owned() }),
        None => Err(HandError::plugin(library, "the library", "files", "nothing")),
    }
}

/// Runs the process to its end; returns none if it had to be ended.
fn run(library: &Path, exchange: &Path) -> Result<Option<ExitStatus>, HandError> {
    let program = program()?;
    let mut child = Command::new(&program)
        .arg(ARGUMENT)
        .args([library, exchange])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .map_err(HandError::io(Path::new(&program)))?;
    let (started, limit) = (Instant::now(), limit());
    loop {
        if let Some(status) = child.try_wait().map_err(HandError::io(Path::new(&program)))? {
            return Ok(Some(status));
        }
        if started.elapsed() > limit {
            // It has ended by itself if these fail.
            let _ = child.kill();
            let _ = child.wait();
            return Ok(None);
        }
        std::thread::sleep(PAUSE);
    }
}

/// Returns the file of this program, also if another one has replaced it.
fn program() -> Result<OsString, HandError> {
    if cfg!(target_os = "linux") {
        return Ok("/proc/self/exe".into());
    }
    let name = Path::new("the program's own file");
    Ok(std::env::current_exe().map_err(HandError::io(name))?.into_os_string())
}

fn limit() -> Duration {
    let seconds = std::env::var(SECONDS).ok().and_then(|text| text.parse::<f64>().ok());
    Duration::from_secs_f64(seconds.filter(|s| (0.001..=1e6).contains(s)).unwrap_or(DEFAULT_SECONDS))
}

/// Returns the files in a result; none if it is cut off.
fn files(mut rest: &[u8]) -> Option<Vec<RawFile>> {
    fn part<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
        let (length, after) = rest.split_first_chunk::<8>()?;
        let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
        let (bytes, after) = after.split_at_checked(length)?;
        *rest = after;
        Some(bytes)
    }
    let mut found = Vec::new();
    while !rest.is_empty() {
        found.push((part(&mut rest)?.to_vec(), part(&mut rest)?.to_vec()));
    }
    Some(found)
}

/// A directory for options and result, which only this user may read.
struct Exchange {
    path: PathBuf,
}

impl Exchange {
    fn create() -> Result<Exchange, HandError> {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        loop {
            let number = NUMBER.fetch_add(1, Ordering::Relaxed);
            let path = std::env::temp_dir().join(format!("eigenhand-plugin-{}-{number}", std::process::id()));
            let mut builder = fs::DirBuilder::new();
            std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
            match builder.create(&path) {
                Ok(()) => return Ok(Exchange { path }),
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(HandError::io(&path)(error)),
            }
        }
    }
}

impl Drop for Exchange {
    fn drop(&mut self) {
        // What is left is temporary.
        let _ = fs::remove_dir_all(&self.path);
    }
}
