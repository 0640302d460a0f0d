//! `cargo xtask same-digits`

use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::Duration;

use anyhow::{Context, bail};
use eigenhand_cli::output::{Outcome, print};
use eigenhand_cli::say;

/// Arguments of the compared run, without its directory.
const RUN: [&str; 6] = ["train", "--hand", "shadow", "--seed", "1", "--quiet"];
/// Column that differs from run to run.
const WALL_TIME: &str = "wall_s";
/// Time between two checks of a run.
const POLL: Duration = Duration::from_secs(1);

/// Checks that a default training gives the same digits as another version of this program
#[derive(clap::Args)]
#[command(
    after_help = "Trains the shadow hand with the defaults, seed 1, until the evaluation at --episodes, and compares\n\
    metrics.csv with that of the other version, column by column, without the wall time. It names columns and\n\
    evaluations that only one version has. Exit status 1 if anything differs.\n\n\
    Examples:\n  cargo xtask same-digits --metrics before/metrics.csv\n  \
    cargo xtask same-digits --program ../before/target/release/xtask"
)]
pub struct Args {
    /// metrics.csv of the other version
    #[arg(long, value_name = "FILE", required_unless_present = "program", conflicts_with = "program")]
    metrics: Option<PathBuf>,
    /// Program of the other version; it trains first
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
    /// Training episodes at the last evaluation that is compared
    #[arg(long, value_name = "N", default_value_t = 400)]
    episodes: u64,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let scratch = tempfile::tempdir().context("cannot make a temporary directory")?;
    let before = match (&args.metrics, &args.program) {
        (Some(file), _) => file.clone(),
        (None, Some(program)) => train(program, &scratch.path().join("before"), args.episodes)?,
        (None, None) => bail!("give --metrics or --program"),
    };
    let own = std::env::current_exe().context("cannot find this program's own file")?;
    let after = train(&own, &scratch.path().join("after"), args.episodes)?;
    let differences = compare(&Table::read(&before)?, &Table::read(&after)?, args.episodes)?;
    if differences.is_empty() {
        print(&format!("the same digits up to episode {}\n", args.episodes))?;
        return Ok(Outcome::Done);
    }
    print(&differences.concat())?;
    Ok(Outcome::Failed)
}

/// Trains until the evaluation at `episodes`, and returns the run's metrics.csv.
fn train(program: &Path, run: &Path, episodes: u64) -> anyhow::Result<PathBuf> {
    say!("training {} episodes with {} ...", episodes, program.display());
    let mut command = Command::new(program);
    let child = command.args(RUN).arg("--out").arg(run).stdout(std::io::stderr()).spawn();
    let mut training = Training(child.with_context(|| format!("cannot run {}", program.display()))?);
    let metrics = run.join("metrics.csv");
    let reached = || Table::read(&metrics).is_ok_and(|table| table.row(episodes).is_some());
    while !reached() {
        if let Some(status) = training.0.try_wait()? {
            bail!("{} ended before episode {episodes} ({status})", program.display());
        }
        std::thread::sleep(POLL);
    }
    Ok(metrics)
}

/// A training process; it is killed when this value is dropped.
struct Training(Child);

impl Drop for Training {
    fn drop(&mut self) {
        // Its directory is removed next, so nothing is lost.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A metrics.csv as text, because the comparison is of digits and not of numbers.
struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    fn read(path: &Path) -> anyhow::Result<Table> {
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        let cells = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
        // A last line without a line end is still being written.
        let whole = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
        let mut lines = whole.lines().map(cells);
        let columns = lines.next().with_context(|| format!("{} is empty", path.display()))?;
        Ok(Table { columns, rows: lines.collect() })
    }

    fn row(&self, episode: u64) -> Option<&Vec<String>> {
        self.rows.iter().find(|row| row.first().is_some_and(|first| *first == episode.to_string()))
    }

    /// Lists the episodes of the evaluations up to one.
    fn episodes(&self, last: u64) -> impl Iterator<Item = u64> {
        self.rows.iter().filter_map(|row| row.first()?.parse().ok()).filter(move |episode| *episode <= last)
    }
}

/// Lists the differences of two tables up to an episode, one line each.
fn compare(before: &Table, after: &Table, episodes: u64) -> anyhow::Result<Vec<String>> {
    if before.row(episodes).is_none() {
        bail!(
            "the other version has no evaluation at episode {episodes}; choose one of its evaluations with --episodes"
        );
    }
    let mut found = Vec::new();
    let only = |a: &Table, b: &Table, side: &str| -> Vec<String> {
        let columns = a.columns.iter().filter(|column| !b.columns.contains(column)).cloned();
        let rows = a.episodes(episodes).filter(|episode| b.row(*episode).is_none());
        let missing = columns.chain(rows.map(|episode| format!("the evaluation at episode {episode}")));
        missing.map(|one| format!("{one} is only in the {side} version\n")).collect()
    };
    found.extend(only(before, after, "other"));
    found.extend(only(after, before, "present"));
    for episode in before.episodes(episodes) {
        let (Some(row), Some(same)) = (before.row(episode), after.row(episode)) else { continue };
        for (column, cell) in before.columns.iter().zip(row).filter(|(column, _)| *column != WALL_TIME) {
            let position = after.columns.iter().position(|other| other == column);
            let Some(other) = position.and_then(|i| same.get(i)) else { continue };
            if other != cell {
                found.push(format!("episode {episode}, {column}: {cell} before, {other} now\n"));
            }
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Table {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("metrics.csv");
        std::fs::write(&path, text).expect("writable");
        Table::read(&path).expect("readable")
    }

    #[test]
    fn a_digit_that_differs_is_named_and_wall_time_is_passed_over() {
        let before = table("episode,wall_s,x\n200,1.5,0.25\n400,3,0.5\n600,5,1\n");
        let same = table("episode,wall_s,x\n200,9,0.25\n400,10,0.5\n600,11,2\n800,");
        assert!(compare(&before, &same, 400).expect("comparable").is_empty());
        let found = compare(&before, &same, 600).expect("comparable");
        assert_eq!(found, ["episode 600, x: 1 before, 2 now\n"]);
        let wider = table("episode,y,wall_s,x\n200,1,9,0.26\n300,1,9,0.5\n");
        let found = compare(&before, &wider, 400).expect("comparable");
        let expected = [
            "the evaluation at episode 400 is only in the other version\n",
            "y is only in the present version\n",
            "the evaluation at episode 300 is only in the present version\n",
            "episode 200, x: 0.25 before, 0.26 now\n",
        ];
        assert_eq!(found, expected);
        let message = compare(&before, &same, 500).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(message.contains("no evaluation at episode 500"), "{message}");
    }
}
