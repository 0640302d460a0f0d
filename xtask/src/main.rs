//! The command line for developers: every command of `eigenhand`, and commands for tests, set-up and generated code.
// The doc comments of arguments are what --help prints, with placeholders in angle brackets.
#![allow(rustdoc::invalid_html_tags)]
#![forbid(unsafe_code)]

mod bindings;
mod cargo;
mod ci;
mod disk;
mod gallery;
mod python;
mod same_digits;
mod setup;
mod test;
mod torture;
mod wheel;

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

/// How a person starts this program.
const NAME: &str = "cargo xtask";

#[derive(Parser)]
#[command(
    name = "cargo xtask",
    bin_name = "cargo xtask",
    version,
    about = "Trains robot hands in MuJoCo to grasp, and computes their postural synergies",
    after_help = "Example:\n  cargo xtask train --hand shadow --preset quick",
    disable_help_subcommand = true
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    #[command(flatten)]
    User(eigenhand_cli::Command),
    Test(test::Args),
    Ci(ci::Args),
    Setup(setup::Args),
    Bindings(bindings::Args),
    SameDigits(same_digits::Args),
    Gallery(gallery::Args),
    Torture(torture::Args),
    Wheel(wheel::Args),
}

fn command() -> clap::Command {
    eigenhand_cli::speak_as(NAME, Cli::command())
}

fn main() -> ExitCode {
    eigenhand_hands::serve_plugins();
    let cli = match Cli::from_arg_matches(&command().get_matches()) {
        Ok(cli) => cli,
        Err(error) => error.exit(),
    };
    eigenhand_cli::exit(match cli.command {
        Command::User(command) => command.run(),
        Command::Test(args) => test::run(&args),
        Command::Ci(args) => ci::run(&args),
        Command::Setup(args) => setup::run(&args),
        Command::Bindings(args) => bindings::run(&args),
        Command::SameDigits(args) => same_digits::run(&args),
        Command::Gallery(args) => gallery::run(&args),
        Command::Torture(args) => torture::run(&args),
        Command::Wheel(args) => wheel::run(&args),
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// Lists the commands below a command and their options, each with all that `--help` says of it.
    fn options(command: &clap::Command, place: &str, found: &mut BTreeSet<String>) {
        for inner in command.get_subcommands() {
            let place = format!("{place} {}", inner.get_name());
            found.insert(format!("{place}: {}", inner.get_about().map(ToString::to_string).unwrap_or_default()));
            for argument in inner.get_arguments() {
                let (help, required) = (argument.get_help(), argument.is_required_set());
                let help = help.map(ToString::to_string).unwrap_or_default();
                // A text that names the program names each by its own name.
                let help = help.replace(NAME, "eigenhand");
                found.insert(format!("{place} {argument} (required: {required}): {help}"));
            }
            options(inner, &place, found);
        }
    }

    #[test]
    fn every_command_of_the_program_is_here_with_the_same_options() {
        let mut program = clap::Command::new("eigenhand").disable_help_subcommand(true);
        program = eigenhand_cli::Command::augment_subcommands(program);
        let mut here = command();
        // Options can be written only after that.
        [&mut program, &mut here].into_iter().for_each(clap::Command::build);
        let (mut users, mut developers) = (BTreeSet::new(), BTreeSet::new());
        options(&program, "", &mut users);
        options(&here, "", &mut developers);
        assert!(users.len() > 50, "{users:?}");
        let missing: Vec<&String> = users.difference(&developers).collect();
        assert!(missing.is_empty(), "cargo xtask lacks {missing:#?}");
        let is_users = |line: &&String| {
            program.get_subcommands().any(|inner| line.split([' ', ':']).nth(1) == Some(inner.get_name()))
        };
        let more: Vec<&String> = developers.difference(&users).filter(is_users).collect();
        assert!(more.is_empty(), "cargo xtask adds {more:#?}");
    }

    #[test]
    fn the_arguments_are_consistent() {
        command().debug_assert();
    }

    #[test]
    fn every_command_shows_an_example() {
        eigenhand_cli::check_examples(&command(), NAME);
    }
}
