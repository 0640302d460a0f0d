//! Notes: one line for each thing that was changed or assumed while a model was read.

use std::path::Path;

/// Adds the note `what: names` with the first few names; without names it adds nothing.
pub(crate) fn note<S: AsRef<str>>(notes: &mut Vec<String>, what: &str, names: &[S]) {
    const SHOWN: usize = 12;
    if names.is_empty() {
        return;
    }
    let shown: Vec<&str> = names.iter().take(SHOWN).map(AsRef::as_ref).collect();
    let more = match names.len().saturating_sub(SHOWN) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    notes.push(format!("{what}: {}{more}", shown.join(", ")));
}

/// Returns the note about a file that [`xml::decode`](crate::xml::decode) read as Latin-1.
pub(crate) fn latin_note(file: &Path) -> String {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    format!("{name} is not UTF-8; it was read as Latin-1")
}
