//! The versions of the C interface between Eigenhand and a compiled hand plugin.
//!
//! A hand is a directory of data wherever that is enough. A compiled plugin is for hands that are generated, and yields
//! the same manifest and files. The sidecar file of such a plugin states these versions, so that they are compared
//! before its library is opened.
#![forbid(unsafe_code)]

/// Major version of the interface: a plugin built for another one is refused.
pub const ABI_MAJOR: u32 = 1;

/// Minor version of the interface: it grows when a function is appended, and older plugins stay valid.
pub const ABI_MINOR: u32 = 0;
