//! The types that cross the boundary: one table of functions, and plain data.
//!
//! Only integers, C functions, and pointers to bytes with a length cross it. The plugin owns everything that it
//! returns; the caller reads it before the next call on the same [`Generated`]. The caller owns everything that it
//! passes; it is valid during the call only.

use std::ffi::c_void;

/// Name of the symbol that a plugin exports.
pub const SYMBOL: &str = "eigenhand_hand_plugin";

/// First field of the table; it marks the symbol as a hand plugin.
pub const MAGIC: u32 = 0x4548_4E44;

/// Major version of the interface: a plugin built for another one is refused.
pub const ABI_MAJOR: u32 = 1;

/// Minor version of the interface: it grows when a function is appended, and older plugins stay valid.
pub const ABI_MINOR: u32 = 0;

/// Result of a function: [`STATUS_OK`], or any other number for a failure.
pub type Status = i32;

/// The function succeeded.
pub const STATUS_OK: Status = 0;

/// The function failed; after [`HandPlugin::generate`], [`HandPlugin::error_message`] gives the reason.
pub const STATUS_ERROR: Status = 1;

/// The function panicked, and the plugin caught the panic.
pub const STATUS_PANIC: Status = 2;

/// Result of one call of [`HandPlugin::generate`]: the files of a hand, or the reason for a failure.
///
/// Only the plugin knows the type behind the pointer. [`HandPlugin::generate`] creates it and [`HandPlugin::free`]
/// frees it.
pub type Generated = c_void;

/// Borrowed bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bytes {
    /// First byte; may be null where `len` is 0.
    pub data: *const u8,
    /// Number of bytes.
    pub len: usize,
}

impl Bytes {
    /// No bytes.
    pub const NONE: Self = Self { data: std::ptr::null(), len: 0 };

    /// Borrows `slice`; the result is valid while the slice lives unchanged.
    pub fn of(slice: &[u8]) -> Self {
        Self { data: slice.as_ptr(), len: slice.len() }
    }
}

/// The first four fields of the table, equal in every version of the interface.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// [`MAGIC`].
    pub magic: u32,
    /// [`ABI_MAJOR`] of the interface that the plugin was built for.
    pub abi_major: u32,
    /// [`ABI_MINOR`] of that interface.
    pub abi_minor: u32,
    /// Size of the plugin's [`HandPlugin`] in bytes: how many functions it has.
    pub struct_size: u32,
}

/// The table that a plugin exports as [`SYMBOL`].
///
/// The table and the functions stay valid and unchanged from the moment the library is opened. No function may unwind
/// or `longjmp` out of itself. The program calls one function at a time, even with several threads, and makes no call
/// while another one runs.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct HandPlugin {
    /// Version of the interface.
    pub header: Header,

    /// `generate(options, options_len, out)` generates a hand.
    ///
    /// `options` are `options_len` bytes of UTF-8: the table `[options]` of the plugin's sidecar as TOML, or no bytes
    /// if the sidecar has no options. The caller owns them; they are valid during the call. `*out` holds null before
    /// the call. The plugin writes a pointer there, **also when it fails**, so that the caller can ask `error_message`;
    /// the caller passes the pointer to `free` once. After a failure without a reason the plugin may leave null there.
    pub generate:
        Option<unsafe extern "C" fn(options: *const u8, options_len: usize, out: *mut *mut Generated) -> Status>,

    /// `file_count(hand, out)` writes the number of the hand's files to `*out`.
    ///
    /// `hand` comes from a `generate` that succeeded, and `free` was not called with it.
    pub file_count: Option<unsafe extern "C" fn(hand: *const Generated, out: *mut usize) -> Status>,

    /// `file(hand, index, name, content)` points `*name` and `*content` at the name and the content of a file.
    ///
    /// `index` is smaller than the number of files. The name is a path below the hand's directory, in UTF-8, with `/`
    /// between its parts. The plugin owns both; they are valid and unchanged until `free(hand)`.
    pub file: Option<
        unsafe extern "C" fn(hand: *const Generated, index: usize, name: *mut Bytes, content: *mut Bytes) -> Status,
    >,

    /// `error_message(hand, out)` points `*out` at the reason for a failure.
    ///
    /// `hand` comes from a `generate` that failed. The message is UTF-8. The plugin owns it; it is valid and unchanged
    /// until `free(hand)`.
    pub error_message: Option<unsafe extern "C" fn(hand: *const Generated, out: *mut Bytes) -> Status>,

    /// `free(hand)` frees the result of `generate` with all its bytes. Null is allowed and does nothing.
    pub free: Option<unsafe extern "C" fn(hand: *mut Generated)>,
}
