//! Finding, checking and loading libmujoco.

use std::error::Error;
use std::ffi::{CStr, OsString, c_char, c_int};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use libloading::Library;

use crate::MuJoCoError;
use crate::bindings::{MuJoCoLibrary, mjVERSION_HEADER};

/// Environment variable that names the library to load instead of the system's.
pub const LIBRARY_VARIABLE: &str = "EIGENHAND_MUJOCO_LIB";

/// The version that the bindings describe, as `mj_version` encodes it.
pub const REQUIRED_VERSION: i32 = mjVERSION_HEADER as i32;

/// File name of the library.
pub const LIBRARY_FILE: &str = if cfg!(target_os = "macos") { "libmujoco.2.2.2.dylib" } else { "libmujoco.so.2.2.2" };

const SYSTEM_NAMES: [&str; 2] =
    [LIBRARY_FILE, if cfg!(target_os = "macos") { "libmujoco.dylib" } else { "libmujoco.so" }];

/// Returns the path in the user's cache where a library is looked for if the system has none; none without a home
/// directory.
pub fn fetched_library() -> Option<PathBuf> {
    let project = directories::ProjectDirs::from("", "", "eigenhand")?;
    Some(project.cache_dir().join("mujoco-2.2.2").join(LIBRARY_FILE))
}

type Handler = Option<unsafe extern "C" fn(*const c_char)>;

/// A loaded libmujoco of the required version.
pub struct MuJoCo {
    pub(crate) api: MuJoCoLibrary,
    origin: String,
}

impl MuJoCo {
    /// Loads the library once per process and returns the shared handle.
    ///
    /// With `EIGENHAND_MUJOCO_LIB`, that library is loaded and no other. Otherwise the search order is
    /// `libmujoco.so.2.2.2`, `libmujoco.so` (on macOS, the `.dylib` of these names), [`fetched_library`]. Any number of
    /// threads may call it at once.
    ///
    /// # Errors
    /// [`MuJoCoError::LibraryMissing`] when no library opens, [`MuJoCoError::LibraryVersion`] when it has
    /// another version. Both messages say what to do.
    pub fn load() -> Result<Arc<MuJoCo>, MuJoCoError> {
        // Opening writes the library's global handlers, so one thread opens and all others wait.
        static LOADED: Mutex<Option<Arc<MuJoCo>>> = Mutex::new(None);
        let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(library) = &*loaded {
            return Ok(Arc::clone(library));
        }
        let opened = Arc::new(Self::open()?);
        *loaded = Some(Arc::clone(&opened));
        Ok(opened)
    }

    /// Returns the file or soname from which the library was loaded.
    pub fn origin(&self) -> &str {
        &self.origin
    }

    /// Returns the version as `"2.2.2"`.
    pub fn version(&self) -> String {
        // SAFETY: `mj_version` takes nothing and reads a constant.
        format_version(unsafe { (self.api.mj_version)() })
    }

    fn open() -> Result<MuJoCo, MuJoCoError> {
        let chosen = std::env::var_os(LIBRARY_VARIABLE).filter(|value| !value.is_empty());
        let candidates: Vec<OsString> = match &chosen {
            Some(path) => vec![path.clone()],
            None => {
                let fetched = fetched_library().filter(|path| path.is_file()).map(PathBuf::into_os_string);
                SYSTEM_NAMES.iter().map(OsString::from).chain(fetched).collect()
            }
        };
        let mut reasons = Vec::new();
        for candidate in &candidates {
            // SAFETY: opening libmujoco runs only its static initialisers, which have no preconditions. A library that
            // the user names is trusted like a program that the user starts.
            match unsafe { Library::new(candidate) } {
                Ok(library) => return Self::check(library, candidate.to_string_lossy().into()),
                Err(error) => reasons.push(match error.source() {
                    Some(reason) => reason.to_string(),
                    None => error.to_string(),
                }),
            }
        }
        Err(MuJoCoError::LibraryMissing {
            tried: candidates.iter().map(|c| c.to_string_lossy().into_owned()).collect::<Vec<_>>().join(", "),
            overridden: chosen.is_some(),
            reason: reasons.join("; "),
        })
    }

    fn check(library: Library, origin: String) -> Result<MuJoCo, MuJoCoError> {
        let not_mujoco =
            |source: libloading::Error| MuJoCoError::NotMuJoCo { origin: origin.clone(), reason: source.to_string() };
        // SAFETY: `mj_version` has had this signature in every release of MuJoCo.
        let found = unsafe {
            let version: libloading::Symbol<unsafe extern "C" fn() -> c_int> =
                library.get(b"mj_version\0").map_err(not_mujoco)?;
            version()
        };
        if found != REQUIRED_VERSION {
            return Err(MuJoCoError::LibraryVersion {
                origin,
                found: format_version(found),
                required: format_version(REQUIRED_VERSION),
            });
        }
        // SAFETY: the version was checked, so these are the documented global function pointers. `load` holds its lock
        // until the first handle exists, so no other thread of this process uses the library yet.
        unsafe {
            let on_error: libloading::Symbol<*mut Handler> = library.get(b"mju_user_error\0").map_err(not_mujoco)?;
            **on_error = Some(fatal);
            let on_warning: libloading::Symbol<*mut Handler> =
                library.get(b"mju_user_warning\0").map_err(not_mujoco)?;
            **on_warning = Some(counted_elsewhere);
        }
        // SAFETY: the version was checked, so every symbol has the signature of the bindings.
        let api = unsafe { MuJoCoLibrary::from_library(library) }.map_err(not_mujoco)?;
        Ok(MuJoCo { api, origin })
    }
}

/// `version` 222 => "2.2.2"; 4000000 => "4.0.0", as MuJoCo writes it since then
fn format_version(version: i32) -> String {
    if version >= 1_000_000 {
        return format!("{}.{}.{}", version / 1_000_000, version / 1000 % 1000, version % 1000);
    }
    format!("{}.{}.{}", version / 100, version / 10 % 10, version % 10)
}

/// Prints a fatal error and ends the process, where MuJoCo itself would wait for a key.
///
/// MuJoCo does not survive a return from here, and unwinding through C is not allowed. Models are checked before they
/// are stepped, so a call means a defect in this program.
unsafe extern "C" fn fatal(message: *const c_char) {
    // SAFETY: MuJoCo passes a NUL-terminated string that lives through the call.
    let text = unsafe { CStr::from_ptr(message) }.to_string_lossy();
    eprintln!("fatal MuJoCo error (a defect of eigenhand, please report it): {text}");
    std::process::abort();
}

/// Does nothing, where MuJoCo itself would write MUJOCO_LOG.TXT: warnings are read from `mjData.warning`.
unsafe extern "C" fn counted_elsewhere(_message: *const c_char) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_that_load_at_once_share_one_library() {
        let barrier = std::sync::Barrier::new(8);
        let loaded: Vec<Arc<MuJoCo>> = std::thread::scope(|scope| {
            let load = || {
                barrier.wait();
                MuJoCo::load().unwrap_or_else(|error| panic!("{error}"))
            };
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(load)).collect();
            threads.into_iter().map(|thread| thread.join().expect("no panic")).collect()
        });
        assert!(loaded.iter().all(|library| Arc::ptr_eq(library, &loaded[0])));
    }

    #[test]
    fn versions_are_read_in_both_ways_of_writing_them() {
        assert_eq!([222, 337, 4_000_000, 4_012_003].map(format_version), ["2.2.2", "3.3.7", "4.0.0", "4.12.3"]);
    }

    #[test]
    fn a_missing_library_is_answered_with_the_variable_that_names_one() {
        let missing =
            |overridden| MuJoCoError::LibraryMissing { tried: String::new(), overridden, reason: String::new() };
        for overridden in [false, true] {
            assert!(missing(overridden).to_string().contains(LIBRARY_VARIABLE));
        }
    }
}
