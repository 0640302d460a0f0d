//! The commands of the program `eigenhand`. Each parses its arguments, calls the libraries and prints. `cargo xtask`
//! has the same commands.
// The doc comments of arguments are what --help prints, with placeholders in angle brackets.
#![allow(rustdoc::invalid_html_tags)]
#![forbid(unsafe_code)]
// `say!` is for this: `eprintln!` panics if nobody reads standard error.
#![deny(clippy::print_stderr)]

mod bench;
mod bundled;
mod completions;
mod doctor;
mod eval;
mod explore;
mod export;
mod hands;
mod numbers;
pub mod output;
mod places;
mod program;
mod render;
mod report;
mod reproduce;
mod settings;
pub mod setup;
mod several;
mod signals;
mod sweep;
mod synergy;
mod train;

use std::process::ExitCode;

use clap::Subcommand;

use crate::output::Outcome;

pub use eigenhand_train::say;
pub use places::search_path;
pub use program::{check_examples, speak_as};
pub use signals::on_stop;
pub use train::INTERRUPTED;

/// Exit status of a wrong command line; clap uses the same.
const USAGE: u8 = 2;

/// The commands for users. The documentation of each command's arguments is its `--help`.
#[allow(missing_docs)]
#[derive(Subcommand)]
pub enum Command {
    Train(Box<train::Args>),
    Eval(eval::Args),
    Reproduce(Box<reproduce::Args>),
    Sweep(sweep::Args),
    Report(report::Args),
    Export(export::Args),
    Render(render::Args),
    Explore(explore::Args),
    Synergy(synergy::Args),
    Hands(hands::Args),
    Bench(bench::Args),
    Doctor(doctor::Args),
    Completions(completions::Args),
}

impl Command {
    /// Runs the command.
    ///
    /// # Errors
    /// The first error, with a message for the user.
    pub fn run(&self) -> anyhow::Result<Outcome> {
        match self {
            Command::Train(args) => train::run(args),
            Command::Eval(args) => eval::run(args),
            Command::Reproduce(args) => reproduce::run(args),
            Command::Sweep(args) => sweep::run(args),
            Command::Report(args) => report::run(args),
            Command::Export(args) => export::run(args),
            Command::Render(args) => render::run(args),
            Command::Explore(args) => explore::run(args),
            Command::Synergy(args) => synergy::run(args),
            Command::Hands(args) => hands::run(args),
            Command::Bench(args) => bench::run(args),
            Command::Doctor(args) => doctor::run(args),
            Command::Completions(args) => completions::run(args),
        }
    }
}

/// Reports a command's error, if it has one, and returns the exit status: 0 for success, 1 for a failure, 2 for a wrong
/// command line, 130 after Ctrl-C.
pub fn exit(outcome: anyhow::Result<Outcome>) -> ExitCode {
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
