//! The command line: parses, dispatches to the libraries, and prints.
// The doc comments of arguments are what --help prints, with placeholders in angle brackets.
#![allow(rustdoc::invalid_html_tags)]
#![forbid(unsafe_code)]

mod bench;
mod checks;
mod doctor;
mod eval;
mod export;
mod hands;
mod output;
mod report;
mod reproduce;
mod setup;
mod train;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::output::Outcome;

/// Exit status of a wrong command line, as clap has it too.
const USAGE: u8 = 2;

#[derive(Parser)]
#[command(
    name = "cargo xtask",
    bin_name = "cargo xtask",
    version,
    about = "Acquires the postural synergies of a robot hand by reinforcement learning in MuJoCo",
    after_help = "Example:\n  cargo xtask train --hand shadow --preset quick",
    disable_help_subcommand = true
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Train(Box<train::Args>),
    Eval(eval::Args),
    Reproduce(Box<reproduce::Args>),
    Report(report::Args),
    Export(export::Args),
    Hands(hands::Args),
    Bench(bench::Args),
    Test(checks::TestArgs),
    Ci(checks::CiArgs),
    Doctor(doctor::Args),
}

fn main() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::Train(args) => train::run(&args),
        Command::Eval(args) => eval::run(&args),
        Command::Reproduce(args) => reproduce::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Hands(args) => hands::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Test(args) => checks::test(&args),
        Command::Ci(args) => checks::ci(&args),
        Command::Doctor(args) => doctor::run(&args),
    };
    match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Failed) => ExitCode::FAILURE,
        Ok(Outcome::Interrupted) => ExitCode::from(train::INTERRUPTED),
        Err(error) => {
            output::report(&error);
            if output::is_usage(&error) { ExitCode::from(USAGE) } else { ExitCode::FAILURE }
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_command_shows_an_example() {
        fn visit(command: &clap::Command, path: &str) {
            let path = format!("{path} {}", command.get_name());
            if command.has_subcommands() {
                command.get_subcommands().for_each(|inner| visit(inner, &path));
            } else {
                let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
                let last = help.lines().last().unwrap_or_default();
                assert!(last.trim_start().starts_with("cargo xtask "), "{path}: its help ends with {last:?}");
            }
        }
        Cli::command().get_subcommands().for_each(|command| visit(command, ""));
    }
}
