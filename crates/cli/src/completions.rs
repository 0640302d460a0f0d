//! `eigenhand completions`

use clap::Subcommand;
use clap_complete::Shell;

use crate::output::{Outcome, print};
use crate::{Command, program};

/// Prints a script with which a shell completes commands and options
#[derive(clap::Args)]
#[command(after_help = "The script is for the installed program.\n\n\
    Examples:\n  eigenhand completions zsh > ~/.zfunc/_eigenhand\n  \
    eigenhand completions bash > ~/.local/share/bash-completion/completions/eigenhand")]
pub struct Args {
    /// The shell
    shell: Shell,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    print(&script(args.shell)?)?;
    Ok(Outcome::Done)
}

fn script(shell: Shell) -> anyhow::Result<String> {
    let mut command = Command::augment_subcommands(clap::Command::new(program::NAME));
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, program::NAME, &mut script);
    Ok(String::from_utf8(script)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shell_has_a_script_with_the_commands() {
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            let script = script(shell).expect("text");
            assert!(script.contains("reproduce") && script.contains("lambda") && script.contains("synergy"), "{shell}");
        }
    }
}
