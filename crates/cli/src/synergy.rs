//! `eigenhand synergy`

use clap::Subcommand;

use crate::output::Outcome;

mod chosen;
mod compare;
mod fit;
mod list;
mod reducers;
mod samples;
mod show;
mod source;

pub(crate) use source::{Source, SpaceName};

/// Lists, shows, compares and fits synergies, and compares ways to fit them
#[derive(clap::Args)]
#[command(after_help = "Example:\n  eigenhand synergy show shadow")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Lists the ready synergies that come with the program
    #[command(after_help = "Examples:\n  eigenhand synergy list\n  eigenhand explore --synergy shadow")]
    List(list::Args),
    /// Shows a synergy's components: which joints each moves, how far, and what it does in words
    #[command(
        after_help = "SOURCE is a run directory, an export, a directory with synergy.toml, such a file, or the name of a ready synergy \
                            (`synergy list`).\n\n\
                            Examples:\n  eigenhand synergy show shadow\n  \
                            eigenhand synergy show runs/shadow-quick-l1-s1-1 --space postures --components 3"
    )]
    Show(show::Args),
    /// Compares two synergies on the joints that both have
    #[command(
        after_help = "SOURCE is a run directory, an export, a directory with synergy.toml, such a file, or the name of a ready synergy \
                            (`synergy list`).\n\n\
                            Example:\n  eigenhand synergy compare runs/shadow-default-l1-s1-1 runs/shadow-default-l1-s2-1"
    )]
    Compare(compare::Args),
    /// Fits a synergy to samples: of runs, or of postures measured elsewhere
    #[command(
        after_help = "A map file has lines such as `columns.J1 = { joint = \"thumb_1\", factor = -1, offset = 0.1 }`.\n\n\
                            Examples:\n  eigenhand synergy fit runs/shadow-default-l1-s1-1 --components 8 --out eight\n  \
                            eigenhand synergy fit runs/*-s1-1 runs/*-s2-1 --space postures --variance 0.9 --out both\n  \
                            eigenhand synergy fit measured.csv --space postures --hand shadow --map names.toml --out mine"
    )]
    Fit(Box<fit::Args>),
    /// Compares ways to express samples by few numbers: PCA, probabilistic PCA, and an autoencoder
    #[command(
        after_help = "Nothing is written. The grasps are divided into parts, and each part is reconstructed by spaces that \
                            were fitted to the others.\n\n\
                            Example:\n  eigenhand synergy reducers runs/shadow-default-l1-s1-1 --components 1,2,3,5"
    )]
    Reducers(Box<reducers::Args>),
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    match &args.command {
        Command::List(args) => list::run(args),
        Command::Show(args) => show::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Fit(args) => fit::run(args),
        Command::Reducers(args) => reducers::run(args),
    }
}
