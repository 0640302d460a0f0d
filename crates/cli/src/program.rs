//! How a person starts this program: `eigenhand`, or `cargo xtask` in a checkout.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap::builder::StyledStr;

/// The program's name in the texts of this crate.
pub(crate) const NAME: &str = "eigenhand";

static SPOKEN: OnceLock<&'static str> = OnceLock::new();

/// Sets the program's name in the examples of `command` and in everything that is printed later.
pub fn speak_as(name: &'static str, command: clap::Command) -> clap::Command {
    // Only the first call has an effect: a process has one name.
    let _ = SPOKEN.set(name);
    rename(command, name)
}

fn rename(command: clap::Command, name: &str) -> clap::Command {
    let renamed = |text: Option<&StyledStr>| {
        text.map(|text| text.to_string().replace(&format!("{NAME} "), &format!("{name} "))).unwrap_or_default()
    };
    let help = renamed(command.get_after_help());
    command
        .after_help(help)
        .mut_args(|arg| {
            let help = renamed(arg.get_help());
            arg.help(help)
        })
        .mut_subcommands(|inner| rename(inner, name))
}

/// Returns a command line of this program, such as `eigenhand eval RUN`.
pub(crate) fn line(arguments: &str) -> String {
    format!("{} {arguments}", SPOKEN.get().copied().unwrap_or(NAME))
}

/// Returns a word of a command line as a shell reads it: in quotes if it needs them.
pub(crate) fn word(text: &str) -> String {
    // A word with a zero byte cannot be typed at all.
    shlex::try_quote(text).map_or_else(|_| text.to_owned(), std::borrow::Cow::into_owned)
}

/// Returns a path as a word of a command line.
pub(crate) fn path(path: &Path) -> String {
    word(&path.to_string_lossy())
}

/// Returns the options for additional directories of hands, which later commands need too.
pub(crate) fn plugins(places: &[PathBuf]) -> String {
    places.iter().map(|place| format!(" --plugins {}", path(place))).collect()
}

/// Asserts that the help of every command ends with an example that starts the program as `name`.
///
/// # Panics
/// When a command has no such example. This is for tests.
pub fn check_examples(command: &clap::Command, name: &str) {
    for inner in command.get_subcommands() {
        if inner.has_subcommands() {
            check_examples(inner, name);
            continue;
        }
        let help = inner.get_after_help().map(ToString::to_string).unwrap_or_default();
        let last = help.lines().last().unwrap_or_default();
        assert!(
            last.trim_start().starts_with(&format!("{name} ")),
            "{}: its help ends with {last:?}",
            inner.get_name()
        );
    }
}
