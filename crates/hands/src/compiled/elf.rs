//! Whether a library is all there.
//!
//! The system's loader maps a library into memory without comparing its length with what its headers say, and ends the
//! process where a part is missing. What is cut off is found here first.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use crate::error::HandError;

const MAGIC: &[u8] = b"\x7fELF";
/// Marks of 64 bits and of little-endian numbers; other files are left to the system, which refuses them by these marks.
const LITTLE_64: &[u8] = &[2, 1];
const HEADER_LEN: usize = 64;
/// Positions in the header, and the least size of a program header; from the ELF-64 object file format, version 1.5.
const PROGRAM_TABLE_AT: usize = 32;
const SECTION_TABLE_AT: usize = 40;
const PROGRAM_ENTRY_AT: usize = 54;
const SECTION_ENTRY_AT: usize = 58;
const PROGRAM_ENTRY_LEN: u64 = 56;
/// Positions in a program header.
const OFFSET_AT: usize = 8;
const FILE_SIZE_AT: usize = 32;

/// Refuses a library that is shorter than its headers say. Files of another format pass.
pub(super) fn check(library: &Path) -> Result<(), HandError> {
    let mut file = File::open(library).map_err(HandError::io(library))?;
    let len = file.metadata().map_err(HandError::io(library))?.len();
    let damaged = |message: String| HandError::DamagedLibrary { file: library.to_path_buf(), message };
    let mut header = [0; HEADER_LEN];
    if len < HEADER_LEN as u64 {
        return Err(damaged(format!("{len} bytes are no library")));
    }
    file.read_exact(&mut header).map_err(HandError::io(library))?;
    if !header.starts_with(MAGIC) || !header[MAGIC.len()..].starts_with(LITTLE_64) {
        return Ok(());
    }
    let table = |at: usize, entry_at: usize| {
        (
            number(&header[at..at + 8]),
            number(&header[entry_at..entry_at + 2]),
            number(&header[entry_at + 2..entry_at + 4]),
        )
    };
    let inside = |offset: u64, size: u64| offset.checked_add(size).is_some_and(|end| end <= len);
    let (sections, entry, n) = table(SECTION_TABLE_AT, SECTION_ENTRY_AT);
    if !inside(sections, entry * n) {
        return Err(damaged(format!(
            "its headers speak of {} bytes, but it has {len}",
            sections.saturating_add(entry * n)
        )));
    }
    let (programs, entry, n) = table(PROGRAM_TABLE_AT, PROGRAM_ENTRY_AT);
    if !inside(programs, entry * n) || entry < PROGRAM_ENTRY_LEN {
        return Err(damaged("its program headers are not in it".to_owned()));
    }
    let mut headers = vec![0; (entry * n) as usize];
    file.seek(SeekFrom::Start(programs)).and_then(|_| file.read_exact(&mut headers)).map_err(HandError::io(library))?;
    for header in headers.chunks_exact(entry as usize) {
        let (offset, size) =
            (number(&header[OFFSET_AT..OFFSET_AT + 8]), number(&header[FILE_SIZE_AT..FILE_SIZE_AT + 8]));
        if !inside(offset, size) {
            return Err(damaged(format!("a part of {size} bytes at {offset} is missing: it has {len}")));
        }
    }
    Ok(())
}

/// Reads an unsigned little-endian number of at most eight bytes.
fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte))
}
