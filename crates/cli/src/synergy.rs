//! `eigenhand synergy`

use clap::Subcommand;

use crate::output::Outcome;

mod compare;
mod fit;
mod samples;
mod show;
mod source;

pub(crate) use source::{Source, SpaceName};

/// Shows, compares and fits synergies
#[derive(clap::Args)]
#[command(after_help = "Example:\n  eigenhand synergy show synergies/shadow")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Shows a synergy's components: which joints each moves, how far, and what it does in words
    #[command(after_help = "SOURCE is a run directory, an export, a directory with synergy.toml, or such a file.\n\n\
                            Examples:\n  eigenhand synergy show synergies/shadow\n  \
                            eigenhand synergy show runs/shadow-quick-l1-s1-1 --space postures --components 3")]
    Show(show::Args),
    /// Compares two synergies on the joints that both have
    #[command(after_help = "SOURCE is a run directory, an export, a directory with synergy.toml, or such a file.\n\n\
                            Example:\n  eigenhand synergy compare runs/shadow-default-l1-s1-1 runs/shadow-default-l1-s2-1")]
    Compare(compare::Args),
    /// Fits a synergy to samples: of runs, or of postures measured elsewhere
    #[command(
        after_help = "A map file has lines such as `columns.J1 = { joint = \"thumb_1\", factor = -1, offset = 0.1 }`.\n\n\
                            Examples:\n  eigenhand synergy fit runs/shadow-default-l1-s1-1 --components 8 --out eight\n  \
                            eigenhand synergy fit runs/*-s1-1 runs/*-s2-1 --space postures --variance 0.9 --out both\n  \
                            eigenhand synergy fit measured.csv --space postures --hand shadow --map names.toml --out mine"
    )]
    Fit(Box<fit::Args>),
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    match &args.command {
        Command::Show(args) => show::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Fit(args) => fit::run(args),
    }
}
