//! `eigenhand sweep`, here and through a real Slurm, with a hand that trains in seconds.
#![forbid(unsafe_code)]
// A helper function of a test fails the test, which is what a panic means here.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

#[path = "../../../tests/workspace/gripper.rs"]
#[allow(dead_code)]
mod gripper;

/// Runs are kept quick: three values of one setting, two of another.
const FILE: &str = r#"
hands = ["gripper"]
lambdas = [0, 1]
seeds = [1, 2]
[grid]
learner.gamma = [0.9, 0.95, 0.98]
"#;

/// A directory with the hand and a sweep file, in which commands run.
struct Place {
    root: TempDir,
}

impl Place {
    fn new(more: &str) -> Place {
        let place = Place { root: TempDir::new().unwrap() };
        let hand = place.path("gripper");
        std::fs::create_dir(&hand).unwrap();
        std::fs::write(hand.join("hand.toml"), gripper::GRIPPER_MANIFEST).unwrap();
        std::fs::write(hand.join("gripper.xml"), gripper::GRIPPER_MODEL).unwrap();
        place.write(more);
        place
    }

    fn write(&self, more: &str) {
        let mut text = format!("{FILE}{more}\n[settings]\n");
        let varied = |setting: &&&str| !["hand=", "lambda=", "workers="].iter().any(|key| setting.starts_with(key));
        for setting in gripper::TINY.iter().filter(varied).filter(|setting| !setting.starts_with("synergy.components"))
        {
            let (key, value) = setting.split_once('=').unwrap();
            let bare = toml::from_str::<toml::Table>(&format!("a = {value}")).is_ok();
            let value = if bare { value.to_owned() } else { format!("{value:?}") };
            let line = if key == "episodes" { String::new() } else { format!("{key} = {value}\n") };
            text.push_str(&line);
        }
        // The gripper has one actuator.
        text.push_str("synergy.components = 1\n");
        std::fs::write(self.path("small.toml"), format!("episodes = 24\n{text}")).unwrap();
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.path().join(name)
    }

    fn eigenhand(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_eigenhand"));
        command.args(arguments).current_dir(self.root.path()).env("EIGENHAND_NO_INSTALL", "1").stdin(Stdio::null());
        command.env("XDG_CACHE_HOME", self.path("cache"));
        command
    }

    /// `sweep small.toml`; the gripper is made for a cube, so its contract has to be forced.
    fn sweep(&self, more: &[&str]) -> Command {
        let mut command = self.eigenhand(&["sweep", "small.toml", "--out", "all", "--force"]);
        command.args(more);
        command
    }

    fn summary(&self, run: &str) -> Option<Value> {
        let text = std::fs::read(self.path("all/gripper").join(run).join("summary.json")).ok()?;
        Some(serde_json::from_slice(&text).unwrap())
    }

    fn episodes(&self, run: &str) -> u64 {
        self.summary(run).map_or(0, |summary| summary["episodes"].as_u64().unwrap())
    }

    fn is_complete(&self, run: &str) -> bool {
        self.summary(run).is_some_and(|summary| !summary["success_rate"].is_null())
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn status(command: &mut Command, expected: i32) -> Output {
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(expected), "{}{}", text(&output.stdout), text(&output.stderr));
    output
}

fn runs() -> Vec<String> {
    let gammas = ["0.9", "0.95", "0.98"];
    let variants = (0..2).flat_map(|lambda| gammas.map(move |gamma| format!("l{lambda}-gamma{gamma}")));
    let variants: Vec<String> = variants.collect();
    (1..=2).flat_map(|seed| variants.iter().map(move |variant| format!("{variant}-s{seed}"))).collect()
}

#[test]
fn a_sweep_trains_every_combination_once() {
    let place = Place::new("");
    let listed = text(&status(&mut place.sweep(&["--dry-run"]), 0).stdout);
    assert_eq!(listed.lines().filter(|line| line.ends_with("new")).count(), 12, "{listed}");
    assert!(!place.path("all").exists(), "a list makes nothing");
    assert!(listed.contains("lambda 1, learner.gamma 0.95"), "{listed}");
    let output = status(&mut place.sweep(&["--jobs", "2", "--json"]), 0);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["studies"][0]["variants"].as_array().unwrap().len(), 6);
    assert!(
        report["studies"][0]["variants"].as_array().unwrap().iter().all(|variant| variant["n_complete"] == 2),
        "{report}"
    );
    assert!(runs().iter().all(|run| place.is_complete(run)));
    let config = std::fs::read_to_string(place.path("all/gripper/l0-gamma0.98-s2/config.toml")).unwrap();
    let config: toml::Table = toml::from_str(&config).unwrap();
    assert_eq!((config["learner"]["gamma"].as_float(), config["seed"].as_integer()), (Some(0.98), Some(2)));
    let again = text(&status(&mut place.sweep(&[]), 0).stderr);
    assert!(again.contains("12 done"), "{again}");
    // Another setting for the runs that are there.
    let file = std::fs::read_to_string(place.path("small.toml")).unwrap();
    std::fs::write(place.path("small.toml"), file.replace("batch_size = 32", "batch_size = 16")).unwrap();
    let refused = text(&status(&mut place.sweep(&[]), 2).stderr);
    assert!(refused.contains("learner.batch_size is 32 there and 16 here"), "{refused}");
}

#[test]
fn only_the_best_go_on_after_a_stage() {
    let place = Place::new("[halving]\nepisodes = [8, 16]\nkeep = 0.5\n");
    let output = status(&mut place.sweep(&["--jobs", "2"]), 0);
    assert!(text(&output.stderr).contains("stage 3 of 3"), "{}", text(&output.stderr));
    let complete: Vec<String> = runs().into_iter().filter(|run| place.is_complete(run)).collect();
    // Of six variants of one hand, three go on, then two.
    assert_eq!(complete.len(), 4, "{complete:?}");
    let others: Vec<u64> = runs().iter().filter(|run| !complete.contains(run)).map(|run| place.episodes(run)).collect();
    assert_eq!(others.iter().filter(|n| (8..16).contains(*n)).count(), 6, "{others:?}");
    assert_eq!(others.iter().filter(|n| (16..24).contains(*n)).count(), 2, "{others:?}");
    let again = text(&status(&mut place.sweep(&[]), 0).stderr);
    assert!(!again.contains("starts") && !again.contains("goes on"), "{again}");
}

#[test]
fn what_is_wrong_in_a_sweep_file_is_named_before_anything_is_made() {
    let place = Place::new("");
    for (more, words) in [
        (
            "[search]\nsamples = 2\n[search.values]\nlearner.tau = { sample = \"log\", low = 0, high = 1 }\n",
            "learner.tau",
        ),
        ("[halving]\nepisodes = [4]\n", "evaluation.every is 8"),
        ("[halving]\nepisodes = [8, 24]\n", "expected fewer than those of a run, 24"),
        ("[slurm]\ncpu = 2\n", "cpu"),
    ] {
        place.write(more);
        let said = text(&status(&mut place.sweep(&[]), 2).stderr);
        assert!(said.contains(words), "{said}");
    }
    std::fs::write(place.path("small.toml"), "[grid]\nlearner.gama = [0.9]\n").unwrap();
    assert!(text(&status(&mut place.sweep(&[]), 2).stderr).contains("learner.gama"));
    assert!(!place.path("all").exists());
    let no_slurm = Place::new("").sweep(&["--slurm"]).env("PATH", "/nowhere").output().unwrap();
    assert!(text(&no_slurm.stderr).contains("without --slurm"), "{}", text(&no_slurm.stderr));
}

/// A Slurm of one node, which ends with the value.
struct Slurm {
    directory: TempDir,
    daemons: Vec<Child>,
}

impl Slurm {
    /// Starts the daemons; none where they are missing, or where this is not root.
    fn start() -> Option<Slurm> {
        let found = |name: &str| ["/usr/sbin", "/usr/bin"].iter().any(|place| Path::new(place).join(name).is_file());
        if !rustix::process::geteuid().is_root()
            || !["slurmctld", "slurmd", "munged", "sbatch"].iter().all(|name| found(name))
        {
            return None;
        }
        let directory = TempDir::new().unwrap();
        let at = |name: &str| directory.path().join(name);
        std::fs::create_dir_all(at("state")).unwrap();
        std::fs::create_dir_all(at("spool")).unwrap();
        std::fs::write(at("key"), [7; 1024]).unwrap();
        Command::new("chmod").arg("400").arg(at("key")).status().unwrap();
        let host = text(&Command::new("hostname").arg("-s").output().unwrap().stdout).trim().to_owned();
        // Ports of this test process, so that two can run on one machine.
        let port = 20_000 + std::process::id() % 20_000;
        let place = directory.path().display();
        let config = format!(
            "ClusterName=test\nSlurmctldHost={host}(127.0.0.1)\nSlurmUser=root\nSlurmdUser=root\nSlurmctldPort={port}\n\
             SlurmdPort={}\nAuthType=auth/munge\nAuthInfo=socket={place}/munge\nCredType=cred/munge\n\
             StateSaveLocation={place}/state\nSlurmdSpoolDir={place}/spool\nSlurmctldPidFile={place}/ctld.pid\n\
             SlurmdPidFile={place}/slurmd.pid\nProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\n\
             SelectType=select/cons_tres\nSelectTypeParameters=CR_CPU\nJobAcctGatherType=jobacct_gather/none\n\
             ReturnToService=2\nMpiDefault=none\nKillWait=20\nSlurmdParameters=config_overrides\nSchedulerParameters=sched_interval=1,bf_interval=1\n\
             NodeName={host} NodeAddr=127.0.0.1 CPUs=4 State=UNKNOWN\nPartitionName=all Nodes={host} Default=YES State=UP\n",
            port + 1
        );
        std::fs::write(at("slurm.conf"), config).unwrap();
        let log = || std::fs::File::options().create(true).append(true).open(at("log")).unwrap();
        let start = |name: &str, arguments: &[String]| -> Child {
            let mut command = Command::new(Path::new("/usr/sbin").join(name));
            command.args(arguments).env("SLURM_CONF", at("slurm.conf")).stdin(Stdio::null());
            command.stdout(log()).stderr(log()).spawn().unwrap()
        };
        let file = |option: &str, name: &str| format!("--{option}={}", at(name).display());
        let munge = [
            "--foreground".to_owned(),
            "--force".to_owned(),
            file("key-file", "key"),
            file("socket", "munge"),
            file("pid-file", "munge.pid"),
            file("log-file", "munge.log"),
            file("seed-file", "munge.seed"),
        ];
        let mut daemons = vec![start("munged", &munge)];
        wait_for("munged", || at("munge").exists());
        daemons.extend(["slurmctld", "slurmd"].map(|name| start(name, &["-D".to_owned()])));
        let slurm = Slurm { directory, daemons };
        wait_for("an idle node", || {
            text(&slurm.command("sinfo", &["-h", "-o", "%t"]).output().unwrap().stdout).contains("idle")
        });
        Some(slurm)
    }

    fn config(&self) -> PathBuf {
        self.directory.path().join("slurm.conf")
    }

    fn command(&self, name: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(name);
        command.args(arguments).env("SLURM_CONF", self.config());
        command
    }

    /// Lines of `squeue`: task and state.
    fn queue(&self) -> Vec<String> {
        text(&self.command("squeue", &["-h", "-r", "-o", "%K %t"]).output().unwrap().stdout)
            .lines()
            .map(str::to_owned)
            .collect()
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        for daemon in self.daemons.iter_mut().rev() {
            let _ = daemon.kill();
            let _ = daemon.wait();
        }
    }
}

fn wait_for(what: &str, mut is_there: impl FnMut() -> bool) {
    let started = Instant::now();
    while !is_there() {
        assert!(started.elapsed() < Duration::from_secs(240), "{what} did not come");
        std::thread::sleep(Duration::from_millis(200));
    }
}

/// Twelve runs go through Slurm; one is cancelled in the middle, and the same command completes it.
#[test]
fn a_sweep_through_slurm_completes_after_a_job_was_cancelled() {
    let Some(slurm) = Slurm::start() else {
        println!("skipped: needs root, slurmctld, slurmd, munged and sbatch");
        return;
    };
    // One core each, four at a time. The runs are long enough for one to be caught in the middle.
    let place = Place::new("[slurm]\ncpus = 1\n");
    let file = std::fs::read_to_string(place.path("small.toml")).unwrap();
    std::fs::write(place.path("small.toml"), file.replacen("episodes = 24", "episodes = 80", 1)).unwrap();
    let submit = || {
        let mut command = place.sweep(&["--slurm"]);
        command.env("SLURM_CONF", slurm.config());
        command
    };
    let said = text(&status(&mut submit(), 0).stdout);
    assert!(said.contains("12 runs as job"), "{said}");
    let cancelled = &runs()[1];
    wait_for("a run in training", || place.path("all/gripper").join(cancelled).join("status.json").exists());
    let job = std::fs::read_to_string(place.path("all/slurm-jobs.txt")).unwrap();
    status(&mut slurm.command("scancel", &[&format!("{job}_1")]), 0);
    let refused = text(&status(&mut submit(), 1).stderr);
    assert!(refused.contains("still queued"), "{refused}");
    wait_for("the end of the jobs", || slurm.queue().is_empty());
    let complete = |run: &&String| place.is_complete(run);
    let log = |task: usize| {
        let text = std::fs::read_to_string(place.path("all").join(format!("slurm-{task}.log"))).unwrap_or_default();
        format!("task {task}:\n{text}")
    };
    let logs = || (0..12).map(log).collect::<String>();
    let all = runs();
    let left: Vec<&String> = all.iter().filter(|run| !complete(run)).collect();
    assert_eq!(left, [cancelled], "{}", logs());
    assert!(log(1).contains("interrupted: everything is saved"), "{}", log(1));
    let said = text(&status(&mut submit(), 0).stdout);
    assert!(said.contains("1 run as job"), "{said}");
    wait_for("the end of the job", || slurm.queue().is_empty());
    assert!(all.iter().all(|run| place.is_complete(run)), "{}", logs());
    // Now there is nothing to submit, and the same command shows the results.
    let said = text(&status(&mut submit(), 0).stdout);
    assert!(said.contains("report:"), "{said}");
}
