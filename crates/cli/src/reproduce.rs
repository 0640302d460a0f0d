//! `eigenhand reproduce`

use std::path::PathBuf;
use std::sync::atomic::Ordering;

use eigenhand_report::counted;
use eigenhand_train::reproduce::{ALL_NUMBERS, Comparison, Member, Reproduction, Request};
use eigenhand_train::request::NewRun;
use eigenhand_train::runs::State;
use eigenhand_train::runs::children::{Ending, train};
use eigenhand_train::say;

use crate::numbers::{LARGEST, number, whole};
use crate::output::Outcome;
use crate::settings::SettingsArgs;
use crate::several::{Share, again, count_signals, display, failed, own_program, same_command};
use crate::{report, setup};

const EXAMPLES: &str = "\
Each run is a separate process, with its own directory l<lambda>-s<seed> and its output in l<lambda>-s<seed>.log. To
continue after an interruption, give the same command again: it keeps complete runs and resumes the others. Ctrl-C
saves and stops all runs (exit status 130); a second Ctrl-C stops them at once.

Examples:
  eigenhand reproduce --lambda 0,0.5,1 --seeds 1,2,3 --out runs/three-lambdas
  eigenhand reproduce --preset quick --seeds 3 --set learner.gamma=0.95
  eigenhand reproduce --study control --seeds 4 --out runs/study
  eigenhand reproduce";

/// Settings of a study, before the user's own: evaluations that are close enough for a curve, and objects that no
/// training sees.
const STUDY_SETTINGS: [&str; 2] = ["evaluation.every=100", "evaluation.other_objects=[\"unseen\"]"];
/// Seeds by default.
const SEEDS: u64 = 5;
/// Seeds of a study by default: with three, a permutation test cannot support a difference.
const STUDY_SEEDS: u64 = 4;

/// Repeats the paper's experiment, or a study: trains several variants for several seeds, and writes a report
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Hand to train, by name or directory [default: the hand in the configuration file, or else the paper's]
    #[arg(long, value_name = "NAME")]
    hand: Option<String>,
    #[command(flatten)]
    settings: SettingsArgs,
    /// How far the policies are confined to their synergies, from 0 to 1, separated by commas
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "0,1", value_parser = number, allow_negative_numbers = true)]
    lambda: Vec<f64>,
    /// Compares action spaces instead of lambdas: every joint, numbers of synergies, random directions, one number by hand
    #[arg(long, value_name = "NAME", value_parser = ["control"], conflicts_with = "lambda")]
    study: Option<String>,
    /// Number of seeds (5 means 1 to 5), or a list such as 1,2,5 or 4-8 [default: 5; 4 for a study]
    #[arg(long, value_name = "SEEDS", value_parser = parse_seeds)]
    seeds: Option<Seeds>,
    /// Number of runs at a time [default: one for every two cores]
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1..=1024))]
    jobs: Option<u64>,
    /// Directory of the runs [default: runs/reproduce-<hand>-<preset>, or runs/study-<hand>-<preset>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Prints the report as JSON on standard output
    #[arg(long)]
    json: bool,
    /// Shows no progress
    #[arg(long)]
    quiet: bool,
    #[command(flatten)]
    install: setup::InstallArgs,
}

/// Seeds as the command line names them.
#[derive(Clone, Debug, PartialEq)]
struct Seeds(Vec<u64>);

/// `5` => 1 to 5; `1,2,5` and `4-8` => those
fn parse_seeds(text: &str) -> Result<Seeds, String> {
    const MOST: u64 = 1000;
    let number = |text: &str| {
        let read = text.trim().parse::<u64>().ok().filter(|n| *n <= LARGEST);
        read.ok_or_else(|| format!("{text:?} is no seed: expected a number such as 5, or a list such as 1,2,5 or 4-8"))
    };
    let range = |first: u64, last: u64| match last.checked_sub(first) {
        Some(more) if more < MOST => Ok((first..=last).collect::<Vec<u64>>()),
        Some(_) => Err(format!("expected at most {MOST} seeds")),
        None => Err(format!("the range {first}-{last} is empty: its first seed is greater than its last")),
    };
    if !text.contains([',', '-']) {
        return match number(text)? {
            0 => Err("expected at least one seed".to_owned()),
            n => range(1, n).map(Seeds),
        };
    }
    let mut seeds = Vec::new();
    for part in text.split(',').filter(|part| !part.trim().is_empty()) {
        match part.split_once('-') {
            Some((first, last)) => seeds.extend(range(number(first)?, number(last)?)?),
            None => seeds.push(number(part)?),
        }
    }
    if seeds.is_empty() { Err("expected at least one seed".to_owned()) } else { Ok(Seeds(seeds)) }
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    setup::ensure_mujoco(&args.install)?;
    let reproduction = Reproduction::prepare(&args.request())?;
    let jobs = reproduction.jobs();
    let share = Share::of(args.jobs, jobs.iter().filter(|job| !job.is_done()).count());
    if !args.quiet {
        say!("{}", heading(&reproduction, share).trim_end());
    }
    let stop = count_signals()?;
    let mut display = display(args.quiet);
    let program = own_program()?;
    let command = |position: usize| {
        let member = &reproduction.members[position];
        let mut command = again(&program);
        reproduction.make_space(member)?;
        command.args(args.arguments(member, &reproduction.config.hand, share.workers));
        Ok(command)
    };
    let endings = train(&jobs, share.jobs, &stop, &command, display.as_mut())?;
    let failed = failed(&jobs, &endings);
    if stop.load(Ordering::Relaxed) > 0 && endings.contains(&Ending::Stopped) {
        say!("continue with: {}", same_command());
        return Ok(Outcome::Interrupted);
    }
    if failed.is_empty() || failed.len() < endings.len() {
        if args.study.is_some() {
            report::show_study(&reproduction.directory, &reproduction.directory.join(report::DIRECTORY), args.json)?;
        } else {
            report::show(&report::of_directory(&reproduction.directory)?, args.json)?;
        }
    }
    if failed.is_empty() {
        return Ok(Outcome::Done);
    }
    say!("failed: {}; try again with: {}", failed.join(", "), same_command());
    Ok(Outcome::Failed)
}

impl Args {
    fn request(&self) -> Request {
        let mut settings = NewRun { hand: self.hand.clone(), default_hand: true, ..self.settings.new_run() };
        settings.assignments = self.assignments();
        let (comparison, seeds) = match self.study {
            Some(_) => (Comparison::ControlStudy, STUDY_SEEDS),
            None => (Comparison::Lambdas(self.lambda.clone()), SEEDS),
        };
        let seeds = self.seeds.as_ref().map_or_else(|| (1..=seeds).collect(), |seeds| seeds.0.clone());
        Request { settings, comparison, seeds, out: self.out.clone() }
    }

    /// Returns the assignments of settings: those of a study, then the user's own.
    fn assignments(&self) -> Vec<String> {
        let of_study = self.study.iter().flat_map(|_| STUDY_SETTINGS).map(str::to_owned);
        of_study.chain(self.settings.assignments.iter().cloned()).collect()
    }

    /// Returns the arguments with which this program trains or resumes a member.
    fn arguments(&self, member: &Member, hand: &str, workers: usize) -> Vec<std::ffi::OsString> {
        let mut arguments = vec!["train".into(), "--no-install".into(), "--workers".into(), workers.to_string().into()];
        let mut option = |name: &str, value: std::ffi::OsString| arguments.extend([name.into(), value]);
        if member.job.state != State::New {
            self.settings.plugins.iter().for_each(|directory| option("--plugins", directory.into()));
            option("--resume", member.job.run.clone().into());
            return arguments;
        }
        option("--lambda", member.variant.lambda.to_string().into());
        option("--seed", member.seed.to_string().into());
        option("--out", member.job.run.clone().into());
        option("--hand", hand.into());
        if let (Some(synergy), Some(numbers)) = (&member.synergy, &member.variant.space) {
            option("--action-space", "synergy".into());
            option("--synergy", synergy.into());
            option("--components", numbers.components.to_string().into());
            option("--set", ALL_NUMBERS.into());
        }
        let episodes = Some(member.job.episodes);
        let settings = SettingsArgs { assignments: self.assignments(), episodes, ..self.settings.clone() };
        arguments.extend(settings.arguments());
        arguments
    }
}

fn heading(reproduction: &Reproduction, Share { jobs, workers }: Share) -> String {
    let Reproduction { directory, config, members, .. } = reproduction;
    let hand = &reproduction.hand.manifest.name;
    let count = |chosen: fn(&State) -> bool| members.iter().filter(|member| chosen(&member.job.state)).count();
    let complete = count(|state| *state == State::Complete);
    let interrupted = count(|state| matches!(state, State::Interrupted { .. }));
    let names: Vec<&str> = members.iter().map(|member| member.job.name.as_str()).collect();
    format!(
        "runs      {}/\nhand      {hand}, preset {}\ntraining  {} with {} episodes in all: {}\n          {complete} complete, \
         {interrupted} to be resumed, {jobs} at a time with {} each\n",
        directory.display(),
        config.preset.name(),
        counted(members.len(), "run"),
        members.iter().map(|member| member.job.episodes).sum::<u64>(),
        names.join(", "),
        counted(workers, "worker"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_a_number_or_a_list() {
        let seeds = |text: &str| parse_seeds(text).map(|seeds| seeds.0);
        assert_eq!(seeds("3"), Ok(vec![1, 2, 3]));
        assert_eq!(seeds("7,1"), Ok(vec![7, 1]));
        assert_eq!(seeds("9,"), Ok(vec![9]));
        assert_eq!(seeds("4-6,1"), Ok(vec![4, 5, 6, 1]));
        for wrong in ["0", "", ",", "a", "1,b", "5-3", "1-", "9999999", "0-99999999999"] {
            assert!(seeds(wrong).is_err(), "{wrong}");
        }
    }
}
