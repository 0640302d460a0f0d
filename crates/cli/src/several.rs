//! What commands share that train several runs, each in a process of its own.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use anyhow::Context;
use eigenhand_train::config::worker_count;
use eigenhand_train::runs::children::Ending;
use eigenhand_train::runs::{Job, OverviewBars, OverviewDisplay, OverviewLines, Silent};
use eigenhand_train::say;

use crate::program;
use crate::signals::on_stop;

/// Cores that one run keeps busy: one learns while another simulates.
const CORES_PER_RUN: usize = 2;
/// Time between two lines of progress where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(30);

/// How many runs train at a time, and with how many workers each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    pub jobs: usize,
    pub workers: usize,
}

impl Share {
    /// (runs at a time that the user asked for, runs that wait) => a share of this machine
    pub fn of(asked: Option<u64>, waiting: usize) -> Share {
        let cores = worker_count(0);
        let jobs = asked.map_or_else(|| (cores / CORES_PER_RUN).max(1), |jobs| jobs as usize).min(waiting.max(1));
        Share { jobs, workers: (cores / jobs).max(1) }
    }
}

/// Returns a display of the progress of all runs on standard error.
pub fn display(quiet: bool) -> Box<dyn OverviewDisplay> {
    match quiet {
        true => Box::new(Silent),
        false if std::io::stderr().is_terminal() => Box::new(OverviewBars::new()),
        false => Box::new(OverviewLines::new(LINE_EVERY)),
    }
}

/// Returns a path to this program, for starting it again. On Linux, the path leads to the running program even if its
/// file has been rebuilt since, so that the same program makes all runs.
pub fn own_program() -> anyhow::Result<PathBuf> {
    let running = PathBuf::from("/proc/self/exe");
    if running.exists() { Ok(running) } else { std::env::current_exe().context("cannot find this program's own file") }
}

/// Returns a command of a program that is this one, under the name by which the user called it.
pub fn again(program: &Path) -> Command {
    let mut command = Command::new(program);
    std::os::unix::process::CommandExt::arg0(&mut command, std::env::args_os().next().unwrap_or_default());
    command
}

/// Counts Ctrl-C and SIGTERM.
pub fn count_signals() -> anyhow::Result<Arc<AtomicUsize>> {
    let stop = Arc::new(AtomicUsize::new(0));
    let counter = Arc::clone(&stop);
    on_stop(move || {
        if counter.fetch_add(1, Ordering::Relaxed) == 0 {
            let newline = if std::io::stderr().is_terminal() { "\n" } else { "" };
            say!("{newline}saving and stopping all runs; Ctrl-C again stops at once{newline}");
        }
    })?;
    Ok(stop)
}

/// Returns the names of the runs that failed.
pub fn failed<'a>(jobs: &'a [Job], endings: &[Ending]) -> Vec<&'a str> {
    let failed = jobs.iter().zip(endings).filter(|(_, ending)| matches!(ending, Ending::Failed { .. }));
    failed.map(|(job, _)| job.name.as_str()).collect()
}

/// Returns the command line in a form that can be typed again.
pub fn same_command() -> String {
    let words: Vec<String> = std::env::args().skip(1).map(|word| program::word(&word)).collect();
    program::line(&words.join(" "))
}
