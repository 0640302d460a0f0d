//! How a person starts this program: `eigenhand`, or `cargo xtask` in a checkout.

use std::sync::OnceLock;

use clap::builder::StyledStr;

/// How the texts of this crate name the program.
const NAME: &str = "eigenhand";

static SPOKEN: OnceLock<&'static str> = OnceLock::new();

/// Makes the examples of `command`, and everything that is printed from now on, name the program as `name`.
pub fn speak_as(name: &'static str, command: clap::Command) -> clap::Command {
    // The first name stays: a process has one.
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

/// Asserts that the help of every command ends with an example that starts the program as `name`.
///
/// # Panics
/// When one does not; for tests.
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
