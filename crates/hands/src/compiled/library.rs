//! Calls into a plugin's library: the only unsafe code of this crate.
//!
//! The user chose to run the library, and it can do what any program can. Its pointers are trusted. Its version, the
//! size of its table, its counts and its lengths are checked, null is an error, and everything is copied out.
#![allow(unsafe_code)]

use std::ffi::OsStr;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use eigenhand_hand_abi::{Bytes, Generated, HandPlugin, Header, MAGIC, STATUS_OK, SYMBOL, Status};
use libloading::os::unix::{Library, RTLD_LOCAL, RTLD_NOW};

use super::sidecar::check_version;
use crate::error::HandError;

/// Most files that a plugin may yield.
const MAX_FILES: usize = 1000;
/// Longest name of a file in bytes.
const MAX_NAME: usize = 255;
/// Most bytes of all files together.
pub(super) const MAX_TOTAL: usize = 256 << 20;
/// Most bytes of an error message that are read.
const MAX_MESSAGE: usize = 64 << 10;

/// A plugin is promised one call at a time.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Name and content of a file, as the plugin gave them.
pub(super) type RawFile = (Vec<u8>, Vec<u8>);

/// Opens `library`, an absolute path, and copies the files that it generates from `options`.
pub(super) fn generate(library: &Path, options: &str) -> Result<Vec<RawFile>, HandError> {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let functions = Functions::of(open(library)?, library)?;
    let mut hand: *mut Generated = std::ptr::null_mut();
    // SAFETY: the version of the function's table was checked, and the options outlive the call.
    let status = unsafe { (functions.generate)(options.as_ptr(), options.len(), &raw mut hand) };
    let copied = if status == STATUS_OK { functions.files(hand) } else { Err(functions.refusal(hand, status)) };
    if !hand.is_null() {
        // SAFETY: the pointer comes from `generate`, is freed once, and everything behind it was copied.
        unsafe { (functions.free)(hand) };
    }
    copied
}

/// Returns the table of a library. The library stays open until the process ends, because threads and destructors of a
/// plugin may outlive the calls.
fn open(library: &Path) -> Result<HandPlugin, HandError> {
    let refused = |message: String| HandError::DamagedLibrary { file: library.to_path_buf(), message };
    // SAFETY: this runs the initialisers of the library; the user named its directory as one of plugins.
    let opened = unsafe { open_now(library.as_os_str()) }.map_err(|error| refused(reason(&error)))?;
    let opened = std::mem::ManuallyDrop::new(opened);
    // SAFETY: the symbol is only an address here.
    let address = unsafe { opened.get::<*const HandPlugin>(SYMBOL) }
        .map(|symbol| *symbol)
        .ok()
        .filter(|address| !address.is_null())
        .ok_or_else(|| HandError::plugin(library, "the library", &format!("a symbol `{SYMBOL}`"), "none"))?;
    // SAFETY: the symbol is an object of the plugin; only the fields that are equal in every version are read.
    let header = unsafe { address.cast::<Header>().read_unaligned() };
    check_header(header, library)?;
    // SAFETY: the header says that the table has this version and at least this size.
    Ok(unsafe { address.read_unaligned() })
}

/// Opens a library and resolves all its symbols at once. A function that is missing is an error now; resolved later, it
/// would end the process at its first call.
unsafe fn open_now(library: &OsStr) -> Result<Library, libloading::Error> {
    // SAFETY: the caller accepts that the library's initialisers run.
    unsafe { Library::open(Some(library), RTLD_NOW | RTLD_LOCAL) }
}

fn check_header(header: Header, library: &Path) -> Result<(), HandError> {
    if header.magic != MAGIC {
        let got = format!("{:#010x}", header.magic);
        return Err(HandError::plugin(library, "magic", &format!("{MAGIC:#010x}, the mark of a hand plugin"), got));
    }
    check_version(header.abi_major, header.abi_minor, library)?;
    if (header.struct_size as usize) < size_of::<HandPlugin>() {
        let expected = format!("at least {} bytes, the table of its version", size_of::<HandPlugin>());
        return Err(HandError::plugin(library, "struct_size", &expected, format!("{} bytes", header.struct_size)));
    }
    Ok(())
}

/// Returns the loader's reason, which is the source of the error.
fn reason(error: &libloading::Error) -> String {
    std::error::Error::source(error).map_or_else(|| error.to_string(), ToString::to_string)
}

type Generate = unsafe extern "C" fn(*const u8, usize, *mut *mut Generated) -> Status;
type FileCount = unsafe extern "C" fn(*const Generated, *mut usize) -> Status;
type GetFile = unsafe extern "C" fn(*const Generated, usize, *mut Bytes, *mut Bytes) -> Status;
type ErrorMessage = unsafe extern "C" fn(*const Generated, *mut Bytes) -> Status;
type Free = unsafe extern "C" fn(*mut Generated);

/// The functions of a table; none is null.
struct Functions<'a> {
    library: &'a Path,
    generate: Generate,
    file_count: FileCount,
    file: GetFile,
    error_message: ErrorMessage,
    free: Free,
}

impl<'a> Functions<'a> {
    fn of(table: HandPlugin, library: &'a Path) -> Result<Self, HandError> {
        let missing = |name: &'static str| move || HandError::plugin(library, name, "a function", "null");
        Ok(Self {
            library,
            generate: table.generate.ok_or_else(missing("generate"))?,
            file_count: table.file_count.ok_or_else(missing("file_count"))?,
            file: table.file.ok_or_else(missing("file"))?,
            error_message: table.error_message.ok_or_else(missing("error_message"))?,
            free: table.free.ok_or_else(missing("free"))?,
        })
    }

    /// Copies the files of a hand from `generate`.
    fn files(&self, hand: *const Generated) -> Result<Vec<RawFile>, HandError> {
        if hand.is_null() {
            return Err(self.wrong("generate", "a hand", "null"));
        }
        let mut n_files = 0;
        // SAFETY: the hand comes from a `generate` that succeeded and is not freed yet.
        self.succeeded("file_count", unsafe { (self.file_count)(hand, &raw mut n_files) })?;
        if n_files > MAX_FILES {
            return Err(self.wrong("file_count", &format!("at most {MAX_FILES} files"), n_files));
        }
        let mut left = MAX_TOTAL;
        let mut files = Vec::with_capacity(n_files);
        for index in 0..n_files {
            let (mut name, mut content) = (Bytes::NONE, Bytes::NONE);
            // SAFETY: as above, and the index is smaller than the number of files.
            let status = unsafe { (self.file)(hand, index, &raw mut name, &raw mut content) };
            self.succeeded("file", status)?;
            let name = self.copy("file", "a name", name, MAX_NAME)?;
            let content = self.copy("file", "content", content, left)?;
            left -= content.len();
            files.push((name, content));
        }
        Ok(files)
    }

    /// Returns the plugin's reason for a failure of `generate`.
    fn refusal(&self, hand: *const Generated, status: Status) -> HandError {
        let message = self.message(hand).filter(|message| !message.is_empty());
        HandError::PluginRefused {
            file: self.library.to_path_buf(),
            message: message.unwrap_or_else(|| format!("status {status} without a message")),
        }
    }

    fn message(&self, hand: *const Generated) -> Option<String> {
        let mut bytes = Bytes::NONE;
        // SAFETY: the hand comes from a `generate` that failed and is not freed yet.
        let told = !hand.is_null() && unsafe { (self.error_message)(hand, &raw mut bytes) } == STATUS_OK;
        let text = told.then(|| self.copy("error_message", "a message", bytes, MAX_MESSAGE))?;
        Some(match text {
            Ok(text) => String::from_utf8_lossy(&text).trim().to_owned(),
            Err(error) => error.to_string(),
        })
    }

    fn succeeded(&self, call: &str, status: Status) -> Result<(), HandError> {
        if status == STATUS_OK { Ok(()) } else { Err(self.wrong(call, "status 0", format!("status {status}"))) }
    }

    /// Copies at most `limit` bytes.
    fn copy(&self, call: &str, what: &str, bytes: Bytes, limit: usize) -> Result<Vec<u8>, HandError> {
        match bytes {
            Bytes { len: 0, .. } => Ok(Vec::new()),
            Bytes { len, .. } if len > limit => {
                Err(self.wrong(call, &format!("{what} of at most {limit} bytes"), format!("{len} bytes")))
            }
            Bytes { data, .. } if data.is_null() => Err(self.wrong(call, what, "null")),
            // SAFETY: the plugin promises that these bytes stay valid until the hand is freed.
            Bytes { data, len } => Ok(unsafe { std::slice::from_raw_parts(data, len) }.to_vec()),
        }
    }

    fn wrong(&self, place: &str, expected: &str, got: impl ToString) -> HandError {
        HandError::plugin(self.library, place, expected, got)
    }
}
