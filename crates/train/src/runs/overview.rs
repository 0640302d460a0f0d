//! The display of the progress of several runs.

use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::progress::Status;
use crate::say;

/// State of all runs.
#[derive(Clone, Debug, Default)]
pub struct Overview {
    /// Runs in all.
    pub runs: usize,
    /// Runs that are complete.
    pub complete: usize,
    /// Runs whose process failed.
    pub failed: usize,
    /// Training episodes so far, over all runs.
    pub episodes: u64,
    /// Training episodes in all.
    pub total: u64,
    /// Time left in s, if it is known.
    pub left_s: Option<f64>,
    /// The runs that train now.
    pub running: Vec<Progressing>,
}

/// A run that trains.
#[derive(Clone, Debug)]
pub struct Progressing {
    /// Its name.
    pub name: String,
    /// Its progress.
    pub status: Status,
}

impl Overview {
    fn counts(&self) -> String {
        let mut text = format!("{} of {} runs complete", self.complete, self.runs);
        if self.failed > 0 {
            text.push_str(&format!(", {} failed", self.failed));
        }
        text
    }

    fn left(&self) -> String {
        let Some(seconds) = self.left_s else { return "-".to_owned() };
        let minutes = (seconds / 60.0).round() as u64;
        if minutes < 60 { format!("{minutes} min") } else { format!("{} h {:02} min", minutes / 60, minutes % 60) }
    }
}

impl Progressing {
    fn line(&self) -> String {
        let percent = |rate: Option<f64>| rate.map_or_else(|| "-".to_owned(), |r| format!("{:.0} %", 100.0 * r));
        let Status { episodes, total, recent_success, evaluated, .. } = self.status;
        let (recent, evaluated) = (percent(recent_success), percent(evaluated));
        format!("{} {episodes}/{total}, success {recent} in training, {evaluated} evaluated", self.name)
    }
}

/// A display of the state of all runs.
pub trait OverviewDisplay {
    /// Shows the current state; called about once a second.
    fn update(&mut self, overview: &Overview);
    /// Shows a line that stays.
    fn note(&mut self, line: &str);
    /// Ends the display.
    fn finish(&mut self) {}
}

/// For a terminal: a bar for all runs, and a line for each run that trains.
pub struct OverviewBars {
    bars: MultiProgress,
    all: ProgressBar,
    lines: Vec<ProgressBar>,
}

impl OverviewBars {
    /// Starts the bars on standard error.
    pub fn new() -> OverviewBars {
        let bars = MultiProgress::with_draw_target(ProgressDrawTarget::stderr_with_hz(4));
        let all = bars.add(ProgressBar::new(0));
        if let Ok(style) =
            ProgressStyle::with_template("{elapsed_precise} {bar:16.cyan/dim} {pos}/{len} episodes, {wide_msg}")
        {
            all.set_style(style);
        }
        OverviewBars { bars, all, lines: Vec::new() }
    }
}

impl Default for OverviewBars {
    fn default() -> Self {
        OverviewBars::new()
    }
}

impl OverviewDisplay for OverviewBars {
    fn update(&mut self, overview: &Overview) {
        self.all.set_length(overview.total);
        self.all.set_position(overview.episodes);
        self.all.set_message(format!("{} left, {}", overview.left(), overview.counts()));
        while self.lines.len() < overview.running.len() {
            let line = self.bars.add(ProgressBar::new(0));
            if let Ok(style) = ProgressStyle::with_template("         {bar:16.blue/dim} {wide_msg}") {
                line.set_style(style);
            }
            self.lines.push(line);
        }
        for line in self.lines.drain(overview.running.len()..) {
            line.finish_and_clear();
            self.bars.remove(&line);
        }
        for (line, running) in self.lines.iter().zip(&overview.running) {
            line.set_length(running.status.total);
            line.set_position(running.status.episodes);
            line.set_message(running.line());
        }
    }

    fn note(&mut self, line: &str) {
        self.bars.suspend(|| say!("{line}"));
    }

    fn finish(&mut self) {
        self.lines.drain(..).for_each(|line| line.finish_and_clear());
        // The bar keeps its position, because the runs may have been stopped.
        self.all.abandon();
    }
}

/// Plain lines on standard error, for a log or a pipe.
pub struct OverviewLines {
    shown: Option<Instant>,
    every: Duration,
}

impl OverviewLines {
    /// Shows a line at most once in `every`.
    pub fn new(every: Duration) -> OverviewLines {
        OverviewLines { shown: None, every }
    }
}

impl OverviewDisplay for OverviewLines {
    fn update(&mut self, overview: &Overview) {
        let now = Instant::now();
        if self.shown.is_some_and(|shown| now - shown < self.every) {
            return;
        }
        self.shown = Some(now);
        let running: Vec<String> = overview.running.iter().map(Progressing::line).collect();
        let Overview { episodes, total, .. } = overview;
        say!("{episodes}/{total} episodes, {} left, {}: {}", overview.left(), overview.counts(), running.join("; "));
    }

    fn note(&mut self, line: &str) {
        say!("{line}");
    }
}

/// Shows nothing.
pub struct Silent;

impl OverviewDisplay for Silent {
    fn update(&mut self, _overview: &Overview) {}
    fn note(&mut self, _line: &str) {}
}
