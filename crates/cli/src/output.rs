//! Output that all commands share.

use std::io::{ErrorKind, Write};

use eigenhand_bench::BenchError;
use eigenhand_hands::HandError;
use eigenhand_onboard::OnboardError;
use eigenhand_report::ReportError;
use eigenhand_train::{TrainError, say};
use serde::Serialize;

use crate::bundled::synergies;
use crate::program;

/// How a command ended, if it had no error.
pub enum Outcome {
    /// With success.
    Done,
    /// It found a failure and has reported it.
    Failed,
    /// The user interrupted it.
    Interrupted,
}

/// Writes to standard output. It is no error if the reader has closed the pipe, as `head` does.
pub fn print(text: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}

/// Writes one JSON document to standard output.
pub fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    print(&text)
}

/// Writes an error with its causes to standard error, without causes that the message repeats.
pub fn report(error: &anyhow::Error) {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text.push_str(&format!(": {cause}"));
        }
    }
    say!("error: {}", text.trim_end());
    let unknown = error.chain().find_map(|cause| match cause.downcast_ref::<HandError>() {
        Some(HandError::UnknownHand { got, .. }) => Some(got),
        _ => match cause.downcast_ref::<TrainError>() {
            Some(TrainError::Hand(HandError::UnknownHand { got, .. })) => Some(got),
            _ => None,
        },
    });
    if let Some(name) = unknown.filter(|name| synergies().contains(&name.as_str())) {
        say!(
            "{name} has a ready synergy (`{}`), but its files are not part of this program: make the hand from them with `{}`",
            program::line(&format!("explore --synergy {name}")),
            program::line(&format!("hands new {name} --from FILE"))
        );
    }
}

/// Tells whether the command line is wrong.
pub fn is_usage(error: &anyhow::Error) -> bool {
    let of_hand =
        |error: &HandError| matches!(error, HandError::UnknownHand { .. } | HandError::NoPluginDirectory { .. });
    let of_bench = |error: &BenchError| match error {
        BenchError::Config(_) => true,
        BenchError::Hand(error) => of_hand(error),
        BenchError::Train(error) => error.is_usage(),
        _ => false,
    };
    error.chain().any(|cause| {
        cause.downcast_ref::<TrainError>().is_some_and(TrainError::is_usage)
            || cause.downcast_ref::<ReportError>().is_some_and(ReportError::is_usage)
            || cause.downcast_ref::<OnboardError>().is_some_and(OnboardError::is_usage)
            || cause.downcast_ref::<BenchError>().is_some_and(of_bench)
            || cause.downcast_ref::<HandError>().is_some_and(of_hand)
    })
}

/// Aligns rows in columns: the first column to the left, the others to the right.
pub fn table(rows: &[Vec<String>]) -> String {
    aligned(rows, false)
}

/// Aligns rows in columns, all to the left.
pub fn table_left(rows: &[Vec<String>]) -> String {
    aligned(rows, true)
}

fn aligned(rows: &[Vec<String>], left: bool) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |i: usize| rows.iter().filter_map(|row| row.get(i)).map(|cell| cell.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for (i, cell) in row.iter().enumerate() {
            let width = widths[i];
            line.push_str(if i == 0 { "" } else { "  " });
            line.push_str(&if left || i == 0 { format!("{cell:<width$}") } else { format!("{cell:>width$}") });
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// `0.934` => `93.4 %`
pub fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// `3725` => `1:02:05`
pub fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    let (hours, minutes, seconds) = (whole / 3600, whole / 60 % 60, whole % 60);
    if hours > 0 { format!("{hours}:{minutes:02}:{seconds:02}") } else { format!("{minutes}:{seconds:02}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let rows = [vec!["a".to_owned(), "10".to_owned()], vec!["long".to_owned(), "9".to_owned()]];
        assert_eq!(table(&rows), "a     10\nlong   9\n");
    }

    #[test]
    fn durations_read_like_a_clock() {
        assert_eq!((duration(65.4), duration(3725.0)), ("1:05".to_owned(), "1:02:05".to_owned()));
    }
}
