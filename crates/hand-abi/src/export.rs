//! The functions of the table for plugins in Rust: one implementation for every generator of hands.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::table::{
    ABI_MAJOR, ABI_MINOR, Bytes, Generated, HandPlugin, Header, MAGIC, STATUS_ERROR, STATUS_OK, STATUS_PANIC, Status,
};

/// The files of a hand's directory, `hand.toml` among them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct HandFiles {
    files: Vec<(String, Vec<u8>)>,
}

impl HandFiles {
    /// Starts a hand without files.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a file. Its name is a path below the hand's directory, with `/` between its parts.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, content: impl Into<Vec<u8>>) -> Self {
        self.files.push((name.into(), content.into()));
        self
    }

    /// Lists names and contents in the order in which they were added.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &[u8])> {
        self.files.iter().map(|(name, content)| (name.as_str(), content.as_slice()))
    }
}

/// A generator of hands. [`export_hand!`](crate::export_hand) implements it.
pub trait Generate {
    /// Generates a hand from options, which are a TOML document.
    ///
    /// # Errors
    /// The error in the options.
    fn generate(options: &str) -> Result<HandFiles, String>;
}

impl HandPlugin {
    /// Returns the table of a generator.
    pub const fn of<G: Generate>() -> Self {
        Self {
            header: Header {
                magic: MAGIC,
                abi_major: ABI_MAJOR,
                abi_minor: ABI_MINOR,
                struct_size: size_of::<HandPlugin>() as u32,
            },
            generate: Some(generate::<G>),
            file_count: Some(file_count),
            file: Some(file),
            error_message: Some(error_message),
            free: Some(free),
        }
    }
}

/// Exports a function as the hand plugin of this library.
///
/// The function takes the options as TOML and returns [`HandFiles`], or a message about an error in the options. A
/// panic in it is caught and becomes an error. A library holds one plugin. The macro also works in a crate that denies
/// unsafe code: it allows the export of this symbol and nothing else.
///
/// ```
/// use eigenhand_hand_abi::{HandFiles, export_hand};
///
/// fn generate(options: &str) -> Result<HandFiles, String> {
///     if !options.is_empty() {
///         return Err(format!("this hand has no options, got {options}"));
///     }
///     Ok(HandFiles::new().with("hand.toml", "schema = 1\n").with("model.xml", "<mujoco/>\n"))
/// }
///
/// export_hand!(generate);
/// # fn main() {}
/// ```
#[macro_export]
macro_rules! export_hand {
    ($generate:path) => {
        #[cfg(panic = "abort")]
        ::core::compile_error!("a hand plugin is built with panic = \"unwind\": a panic must not end the program");

        const _: () = {
            struct Exported;

            impl $crate::Generate for Exported {
                fn generate(options: &str) -> ::core::result::Result<$crate::HandFiles, ::std::string::String> {
                    $generate(options)
                }
            }

            #[allow(unsafe_code, missing_docs)]
            #[unsafe(export_name = "eigenhand_hand_plugin")]
            pub static PLUGIN: $crate::HandPlugin = $crate::HandPlugin::of::<Exported>();
        };
    };
}

/// The type behind a pointer to [`Generated`].
type Outcome = Result<HandFiles, String>;

unsafe extern "C" fn generate<G: Generate>(options: *const u8, options_len: usize, out: *mut *mut Generated) -> Status {
    if out.is_null() || (options.is_null() && options_len > 0) {
        return STATUS_ERROR;
    }
    let bytes = match options_len {
        0 => &[],
        // SAFETY: the caller promises these bytes for the time of the call, and null was excluded.
        n => unsafe { std::slice::from_raw_parts(options, n) },
    };
    let outcome: Outcome = match std::str::from_utf8(bytes) {
        Ok(options) => {
            catch_unwind(|| G::generate(options)).unwrap_or_else(|panic| Err(format!("panicked: {}", said(&*panic))))
        }
        Err(error) => Err(format!("the options are not UTF-8: {error}")),
    };
    let status = if outcome.is_ok() { STATUS_OK } else { STATUS_ERROR };
    // SAFETY: the caller passes a place for a pointer, and null was excluded.
    unsafe { *out = Box::into_raw(Box::new(outcome)).cast() };
    status
}

unsafe extern "C" fn file_count(hand: *const Generated, out: *mut usize) -> Status {
    guarded(|| {
        // SAFETY: each pointer is null or valid, as the table requires of the caller.
        let (hand, out) = unsafe { (hand.cast::<Outcome>().as_ref(), out.as_mut()) };
        let (Some(Ok(hand)), Some(out)) = (hand, out) else { return STATUS_ERROR };
        *out = hand.files.len();
        STATUS_OK
    })
}

unsafe extern "C" fn file(hand: *const Generated, index: usize, name: *mut Bytes, content: *mut Bytes) -> Status {
    guarded(|| {
        // SAFETY: each pointer is null or valid, as the table requires of the caller.
        let (hand, name, content) = unsafe { (hand.cast::<Outcome>().as_ref(), name.as_mut(), content.as_mut()) };
        let (Some(Ok(hand)), Some(name), Some(content)) = (hand, name, content) else { return STATUS_ERROR };
        let Some(file) = hand.files.get(index) else { return STATUS_ERROR };
        (*name, *content) = (Bytes::of(file.0.as_bytes()), Bytes::of(&file.1));
        STATUS_OK
    })
}

unsafe extern "C" fn error_message(hand: *const Generated, out: *mut Bytes) -> Status {
    guarded(|| {
        // SAFETY: each pointer is null or valid, as the table requires of the caller.
        let (hand, out) = unsafe { (hand.cast::<Outcome>().as_ref(), out.as_mut()) };
        let (Some(Err(message)), Some(out)) = (hand, out) else { return STATUS_ERROR };
        *out = Bytes::of(message.as_bytes());
        STATUS_OK
    })
}

unsafe extern "C" fn free(hand: *mut Generated) {
    guarded(|| {
        if !hand.is_null() {
            // SAFETY: the pointer comes from a box in `generate`, and the caller passes it here once.
            drop(unsafe { Box::from_raw(hand.cast::<Outcome>()) });
        }
        STATUS_OK
    });
}

/// Catches a panic: if it left a C function, it would end the process.
fn guarded(body: impl FnOnce() -> Status) -> Status {
    catch_unwind(AssertUnwindSafe(body)).unwrap_or(STATUS_PANIC)
}

/// Returns the message of a panic.
fn said(panic: &(dyn Any + Send)) -> &str {
    match (panic.downcast_ref::<&str>(), panic.downcast_ref::<String>()) {
        (Some(text), _) => text,
        (None, Some(text)) => text,
        (None, None) => "with no message",
    }
}
