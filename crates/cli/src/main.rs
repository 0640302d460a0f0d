//! The program `eigenhand`.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser};
use eigenhand_cli::Command;

#[derive(Parser)]
#[command(
    name = "eigenhand",
    version,
    about = "Trains robot hands in MuJoCo to grasp, and computes their postural synergies",
    after_help = "Example:\n  eigenhand train --hand shadow --preset quick",
    disable_help_subcommand = true
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

fn main() -> ExitCode {
    eigenhand_hands::serve_plugins();
    match Cli::from_arg_matches(&Cli::command().get_matches()) {
        Ok(cli) => eigenhand_cli::exit(cli.command.run()),
        Err(error) => error.exit(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_command_shows_an_example() {
        eigenhand_cli::check_examples(&Cli::command(), "eigenhand");
    }
}
