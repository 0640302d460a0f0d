//! Trains each run in its own process, several at a time, so that a crash costs only one run.

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::progress::Status;
use crate::runs::{Job, Overview, OverviewDisplay, Progressing, State};
use crate::status::{read_status, remove_status};
use crate::{Summary, TrainError};
use eigenhand_files::cannot;

/// Time between two checks of the processes.
const POLL: Duration = Duration::from_millis(100);
/// Time between two reads of their progress.
const READ_EVERY: Duration = Duration::from_secs(1);
/// Bytes at the end of a log that are searched for the error of a failed run.
const TAIL: u64 = 8192;
/// Beginning of a program's error message.
const ERROR: &str = "error: ";
/// Number of last lines of a failed run that are shown.
const SHOWN_LINES: usize = 8;

/// How a run ended in this session.
#[derive(Clone, Debug, PartialEq)]
pub enum Ending {
    /// Nothing was left to be trained.
    WasDone,
    /// It was trained to its end.
    Done,
    /// It was stopped, or not started, because the user asked to stop.
    Stopped,
    /// Its process failed.
    Failed {
        /// How the process ended.
        status: String,
        /// The last lines that it printed.
        lines: Vec<String>,
    },
}

struct Running<'a> {
    job: &'a Job,
    position: usize,
    child: Child,
    /// Length of the log when the process started.
    log_start: u64,
    status: Option<Status>,
}

/// Trains the runs that are not done, up to `at_a_time` at a time, and returns how each ended, in their order.
///
/// `command` gets the position of a run, and returns the command that trains it or, depending on its state, resumes it. A run
/// that needs another starts once that one is done, and fails if it cannot become so. `stop` counts requests to stop: after
/// the first, the processes are interrupted and save; after the second, they are killed.
///
/// # Errors
/// [`TrainError::File`] when waiting for a process fails, or its files cannot be read; running processes are stopped
/// first. A process that cannot be started is no error of this function: its run has [`Ending::Failed`].
pub fn train(
    jobs: &[Job],
    at_a_time: usize,
    stop: &AtomicUsize,
    command: &dyn Fn(usize) -> Result<Command, TrainError>,
    display: &mut dyn OverviewDisplay,
) -> Result<Vec<Ending>, TrainError> {
    let mut session = Session::new(jobs);
    let outcome = session.run(at_a_time.max(1), stop, command, display);
    display.finish();
    outcome?;
    Ok(std::mem::take(&mut session.endings).into_iter().map(|ending| ending.unwrap_or(Ending::Stopped)).collect())
}

struct Session<'a> {
    jobs: &'a [Job],
    endings: Vec<Option<Ending>>,
    running: Vec<Running<'a>>,
    started: Instant,
    /// Episodes that were done before this session.
    done_before: u64,
}

impl<'a> Session<'a> {
    fn new(jobs: &'a [Job]) -> Session<'a> {
        let ending = |job: &Job| (job.is_done()).then_some(Ending::WasDone);
        Session {
            jobs,
            endings: jobs.iter().map(ending).collect(),
            running: Vec::new(),
            started: Instant::now(),
            done_before: jobs.iter().map(Job::episodes_done).sum(),
        }
    }

    fn run(
        &mut self,
        at_a_time: usize,
        stop: &AtomicUsize,
        command: &dyn Fn(usize) -> Result<Command, TrainError>,
        display: &mut dyn OverviewDisplay,
    ) -> Result<(), TrainError> {
        let jobs = self.jobs;
        let mut waiting: Vec<(usize, &Job)> = jobs.iter().enumerate().filter(|(_, job)| !job.is_done()).collect();
        let mut heeded = 0;
        let mut read: Option<Instant> = None;
        loop {
            let asked = stop.load(Ordering::Relaxed);
            while asked == 0 && self.running.len() < at_a_time {
                let Some((position, job)) = self.next_ready(&mut waiting) else { break };
                match start(job, position, command) {
                    Ok(running) => {
                        display.note(&format!("{} {}", job.name, verb(job)));
                        self.running.push(running);
                    }
                    Err(error) => {
                        let lines = error.to_string().lines().map(str::to_owned).collect();
                        let ending = Ending::Failed { status: "it did not start".to_owned(), lines };
                        display.note(&describe(job, &ending));
                        self.endings[position] = Some(ending);
                    }
                }
            }
            if asked > heeded {
                heeded = asked;
                self.running.iter_mut().for_each(|running| if asked == 1 { interrupt(running) } else { kill(running) });
            }
            if read.is_none_or(|read| read.elapsed() >= READ_EVERY) {
                read = Some(Instant::now());
                self.running
                    .iter_mut()
                    .for_each(|running| running.status = read_status(&running.job.run).or(running.status));
                display.update(&self.overview());
            }
            self.reap(asked > 0, display)?;
            if self.running.is_empty() && (asked > 0 || waiting.is_empty()) {
                display.update(&self.overview());
                return Ok(());
            }
            if self.running.is_empty() {
                self.give_up(&mut waiting, display);
            }
            std::thread::sleep(POLL);
        }
    }

    /// Tells whether the run that has to be complete before a job is done.
    fn is_ready(&self, job: &Job) -> bool {
        let Some(needed) = &job.needs else { return true };
        let mut jobs = self.jobs.iter().zip(&self.endings);
        jobs.any(|(m, ending)| m.run == *needed && matches!(ending, Some(Ending::WasDone | Ending::Done)))
    }

    /// Removes the first waiting member that can start, and returns it.
    fn next_ready(&self, waiting: &mut Vec<(usize, &'a Job)>) -> Option<(usize, &'a Job)> {
        let next = waiting.iter().position(|(_, job)| self.is_ready(job))?;
        Some(waiting.remove(next))
    }

    /// Ends all waiting jobs if none of them can start, while nothing runs.
    fn give_up(&mut self, waiting: &mut Vec<(usize, &'a Job)>, display: &mut dyn OverviewDisplay) {
        if waiting.iter().any(|(_, job)| self.is_ready(job)) {
            return;
        }
        for (position, job) in waiting.drain(..) {
            let needed = job.needs.iter().map(|run| run.display().to_string()).collect::<String>();
            let ending = Ending::Failed {
                status: "it did not start".to_owned(),
                lines: vec![format!("{ERROR}it needs {needed}, which is not complete")],
            };
            display.note(&describe(job, &ending));
            self.endings[position] = Some(ending);
        }
    }

    /// Removes the processes that have ended from the running ones.
    fn reap(&mut self, stopping: bool, display: &mut dyn OverviewDisplay) -> Result<(), TrainError> {
        let mut i = 0;
        while i < self.running.len() {
            let running = &mut self.running[i];
            let ended = running.child.try_wait().map_err(cannot("wait for", &running.job.run))?;
            let Some(status) = ended else {
                i += 1;
                continue;
            };
            let running = self.running.swap_remove(i);
            let ending = ending(&running, status, stopping)?;
            display.note(&describe(running.job, &ending));
            self.endings[running.position] = Some(ending);
        }
        Ok(())
    }

    fn overview(&self) -> Overview {
        let status = |running: &Running<'_>| {
            let (episodes, total) = (running.job.episodes_done(), running.job.target());
            running.status.unwrap_or(Status { episodes, total, ..Status::default() })
        };
        let (mut episodes, mut remaining) = (0, 0);
        let (mut complete, mut failed) = (0, 0);
        for (job, ending) in self.jobs.iter().zip(&self.endings) {
            let running = self.running.iter().find(|running| running.job == job);
            let done = running.map_or(job.episodes_done(), |running| status(running).episodes);
            match ending {
                Some(Ending::WasDone | Ending::Done) => {
                    complete += 1;
                    episodes += job.target();
                }
                Some(Ending::Failed { .. }) => failed += 1,
                Some(Ending::Stopped) | None => {
                    episodes += done;
                    remaining += job.target().saturating_sub(done);
                }
            }
        }
        let gained = episodes.saturating_sub(self.done_before);
        let each = self.started.elapsed().as_secs_f64() / gained as f64;
        Overview {
            runs: self.jobs.len(),
            complete,
            failed,
            episodes,
            total: self.jobs.iter().map(Job::target).sum(),
            left_s: (gained > 0).then_some(each * remaining as f64),
            running: self
                .running
                .iter()
                .map(|running| Progressing { name: running.job.name.clone(), status: status(running) })
                .collect(),
        }
    }
}

/// Stops every process when the session ends, also after an error or a panic.
impl Drop for Session<'_> {
    fn drop(&mut self) {
        self.running.iter_mut().for_each(interrupt);
        for running in &mut self.running {
            // The error that led here is the one to report.
            let _ = running.child.wait();
        }
    }
}

fn start<'a>(
    job: &'a Job,
    position: usize,
    command: &dyn Fn(usize) -> Result<Command, TrainError>,
) -> Result<Running<'a>, TrainError> {
    if job.state == State::New {
        job.clear()?;
    }
    remove_status(&job.run)?;
    let log = OpenOptions::new().create(true).append(true).open(&job.log).map_err(cannot("open", &job.log))?;
    let log_start = log.metadata().map_err(cannot("read", &job.log))?.len();
    let second = log.try_clone().map_err(cannot("open", &job.log))?;
    let mut command = command(position)?;
    command.stdin(Stdio::null()).stdout(log).stderr(second);
    // Ctrl-C on a terminal reaches every process of a group. In groups of their own, the children hear of it only from
    // this process, and only once.
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let child = command.spawn().map_err(cannot("start", Path::new(command.get_program())))?;
    Ok(Running { job, position, child, log_start, status: None })
}

/// Asks a process to save and end.
fn interrupt(running: &mut Running<'_>) {
    let pid = i32::try_from(running.child.id()).ok().and_then(rustix::process::Pid::from_raw);
    // It is no error if the process has ended by now.
    let _ = pid.map(|pid| rustix::process::kill_process(pid, rustix::process::Signal::INT));
}

fn kill(running: &mut Running<'_>) {
    // As in `interrupt`.
    let _ = running.child.kill();
}

fn ending(running: &Running<'_>, status: ExitStatus, stopping: bool) -> Result<Ending, TrainError> {
    let mut job = running.job.clone();
    job.refresh()?;
    if status.success() && job.is_done() {
        return Ok(Ending::Done);
    }
    if stopping {
        return Ok(Ending::Stopped);
    }
    let text = tail(running).unwrap_or_default();
    let mut lines: Vec<String> = text.lines().filter(|line| !line.trim().is_empty()).map(str::to_owned).collect();
    let error = lines.iter().rposition(|line| line.starts_with(ERROR));
    lines.drain(..error.unwrap_or(0).max(lines.len().saturating_sub(SHOWN_LINES)));
    Ok(Ending::Failed { status: status.to_string(), lines })
}

fn verb(job: &Job) -> &'static str {
    if job.state == State::New { "starts" } else { "goes on" }
}

fn describe(job: &Job, ending: &Ending) -> String {
    match ending {
        Ending::WasDone | Ending::Done if job.until.is_some_and(|until| until < job.episodes) => {
            format!("{} has {} of {} episodes", job.name, job.target(), job.episodes)
        }
        Ending::WasDone | Ending::Done => match Summary::read(&job.run) {
            Ok(Some(Summary { success_rate: Some(rate), wall_s, .. })) => {
                format!("{} is complete: success {:.1} %, {:.0} min", job.name, 100.0 * rate, wall_s / 60.0)
            }
            _ => format!("{} is complete", job.name),
        },
        Ending::Stopped => format!("{} is stopped", job.name),
        Ending::Failed { status, lines } => {
            let mut text = format!("{} failed ({status}), see {}:", job.name, job.log.display());
            lines.iter().for_each(|line| text.push_str(&format!("\n  {line}")));
            text
        }
    }
}

/// Reads the end of a process's output.
fn tail(running: &Running<'_>) -> std::io::Result<String> {
    let mut file = File::open(&running.job.log)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(running.log_start.max(length.saturating_sub(TAIL))))?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
