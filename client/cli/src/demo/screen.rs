//! What the demo shows: a picture that changes in a terminal, plain lines elsewhere, nothing but the summary as JSON.

use super::book::Page;
use super::live::Outcome;
use super::percentiles::Percentiles;
use super::picture::{Colour, Picture};
use super::replay::Replay;
use super::report::{Summary, causes, sum};
use super::viewer::Verdict;
use crate::Failure;
use crate::args::DemoArgs;
use crate::output::{duration, json, line};
use crossterm::cursor::{MoveToColumn, MoveUp};
use crossterm::style::{
    Attribute, Color, Print, ResetColor, SetAttribute, SetBackgroundColor, SetForegroundColor,
};
use crossterm::terminal::{Clear, ClearType};
use crossterm::{Command, terminal};
use std::io::{IsTerminal, Write, stdout};

/// What there is to see at one moment.
pub struct Frame<'a> {
    /// Since the start of the live part.
    pub seconds: f64,
    /// What goes on.
    pub caption: &'static str,
    /// The last picture.
    pub picture: Option<&'a Picture>,
    /// Events a second into the daemon.
    pub in_evs: f64,
    /// Events a second out of it.
    pub out_evs: f64,
    /// What the filter did, of a scene.
    pub verdict: Option<&'a Verdict>,
    /// Latency of iceoryx2 alone.
    pub floor: Percentiles,
    /// Process of the daemon, number of its generation, and whether it is there.
    pub daemon: (u32, u64, bool),
    /// The readers.
    pub readers: [ReaderLine; 2],
}

/// A reader at one moment.
pub struct ReaderLine {
    /// Its name.
    pub name: &'static str,
    /// Its process.
    pub pid: u32,
    /// What it does.
    pub state: &'static str,
    /// The newest generation it saw.
    pub page: Page,
    /// From due to received.
    pub latency: Percentiles,
}

enum Mode {
    /// Frames over one another.
    Terminal(Paint),
    /// A line now and then.
    Plain,
    /// Nothing but the summary.
    Json,
}

/// Colours that the terminal knows.
#[derive(Clone, Copy)]
enum Paint {
    True,
    Indexed,
}

/// Where the demo shows itself.
pub struct Screen {
    mode: Mode,
    /// Lines of the frame that is on screen.
    height: u16,
    /// When the next plain line is due, and the caption of the last.
    line_due: f64,
    caption: &'static str,
}

impl Screen {
    /// The screen there is.
    pub fn new(args: &DemoArgs) -> Self {
        let variable = |name: &str| std::env::var(name).unwrap_or_default();
        let dumb = matches!(variable("TERM").as_str(), "" | "dumb");
        let mode = if args.json {
            Mode::Json
        } else if !stdout().is_terminal() || dumb {
            Mode::Plain
        } else if matches!(variable("COLORTERM").as_str(), "truecolor" | "24bit") {
            Mode::Terminal(Paint::True)
        } else {
            Mode::Terminal(Paint::Indexed)
        };
        Self { mode, height: 0, line_due: 0.0, caption: "" }
    }

    /// Tells what goes on, between the parts.
    pub fn say(&mut self, text: &str) -> Result<(), Failure> {
        match self.mode {
            Mode::Json => Ok(()),
            _ => line(format!("· {text}")),
        }
    }

    /// Shows a moment.
    pub fn frame(&mut self, frame: &Frame<'_>) -> Result<(), Failure> {
        match self.mode {
            Mode::Json => Ok(()),
            Mode::Plain => self.plain(frame),
            Mode::Terminal(paint) => self.draw(frame, paint),
        }
    }

    /// A line a second, and one for each thing done.
    fn plain(&mut self, frame: &Frame<'_>) -> Result<(), Failure> {
        if self.caption != frame.caption {
            self.caption = frame.caption;
            self.line_due = frame.seconds + 1.0;
            return line(format!("[{:5.1} s] {}", frame.seconds, frame.caption));
        }
        if frame.seconds < self.line_due {
            return Ok(());
        }
        self.line_due = frame.seconds + 1.0;
        line(format!("[{:5.1} s] {}", frame.seconds, rates(frame)))?;
        figures(frame).into_iter().try_for_each(|text| line(format!("          {text}")))
    }

    fn draw(&mut self, frame: &Frame<'_>, paint: Paint) -> Result<(), Failure> {
        let (columns, rows) = terminal::size().unwrap_or((100, 30));
        let mut text = Text::default();
        if self.height > 0 {
            text.put(MoveUp(self.height));
        }
        let mut lines = Vec::new();
        let around = 3 + figures(frame).len();
        if let Some(picture) = frame.picture {
            lines.extend(side_by_side(picture, columns, rows.saturating_sub(around as u16 + 1), paint));
        }
        lines.push(
            format!("{}", SetAttribute(Attribute::Bold))
                + frame.caption
                + &format!("{}", SetAttribute(Attribute::Reset)),
        );
        lines.push(rates(frame));
        lines.extend(figures(frame));
        self.height = lines.len() as u16;
        for line in lines {
            // A line that wraps would shift the frames: it is cut where the terminal ends.
            text.put(MoveToColumn(0));
            text.put(Print(cut(&line, columns.into())));
            text.put(ResetColor);
            text.put(Clear(ClearType::UntilNewLine));
            text.put(Print("\n"));
        }
        text.put(Clear(ClearType::FromCursorDown));
        let mut out = stdout().lock();
        out.write_all(text.0.as_bytes())?;
        Ok(out.flush()?)
    }

    /// Shows what is left at the end.
    pub fn end(&mut self, outcome: &Outcome, replay: &Replay, summary: &Summary) -> Result<(), Failure> {
        if let Mode::Json = self.mode {
            return json(summary);
        }
        line("")?;
        line("in = delivered + filtered + lost")?;
        for (name, report) in ["steady", "second"].into_iter().zip(&outcome.reports) {
            line(format!("client {name}, from its first packet of each generation of the daemon on:"))?;
            for (number, page) in report.book.pages.iter().enumerate() {
                line(format!("  generation {}: {}{}", number + 1, sum(page), causes(page)))?;
            }
        }
        if let Some(verdict) = &outcome.verdict {
            line(judgement(verdict))?;
        }
        latency(summary.latency_ns, summary.floor_ns).iter().try_for_each(line)?;
        let equal = if replay.is_equal() { "yes" } else { "NO" };
        line(format!("lossless replay of {} events: sha256 live = offline: {equal}", replay.events))?;
        line(format!("  {}", replay.sha256_live))?;
        line(format!("picture, raw beside filtered: {}", summary.png.display()))?;
        line("")?;
        self.what_next(outcome)
    }

    fn what_next(&self, outcome: &Outcome) -> Result<(), Failure> {
        let with = match &outcome.kept {
            Some(root) => {
                line(format!(
                    "the daemon was left running (pid {}); in another terminal:",
                    outcome.daemon_pid
                ))?;
                format!("LOBULA_ROOT={root} ")
            }
            None => {
                line("to try next, each in a terminal of its own:")?;
                line("  lobula serve                  the daemon, with the synthetic camera")?;
                String::new()
            }
        };
        line(format!("  {with}lobula top                    how the daemon is"))?;
        line(format!("  {with}lobula echo events -n 10      the next ten events"))?;
        line("  lobula info RECORDING.raw     what is in a recording")
    }
}

fn rates(frame: &Frame<'_>) -> String {
    let (pid, generation, there) = frame.daemon;
    let daemon = if there { "serves" } else { "GONE" };
    format!(
        "daemon {daemon}, pid {pid}, generation {generation}: {:.2} Mev/s in, {:.2} Mev/s out",
        frame.in_evs / 1e6,
        frame.out_evs / 1e6
    )
}

/// The lines under the picture, none longer than 80 characters.
fn figures(frame: &Frame<'_>) -> Vec<String> {
    let mut lines: Vec<_> = frame.verdict.map(judgement).into_iter().collect();
    lines.extend(latency(frame.readers[0].latency, frame.floor));
    for reader in &frame.readers {
        lines.push(format!("client {} (pid {}) {}:", reader.name, reader.pid, reader.state));
        lines.push(format!("  {}", sum(&reader.page)));
    }
    lines
}

fn latency(ours: Percentiles, floor: Percentiles) -> [String; 2] {
    [
        format!("latency, due to received:  {}", times(ours)),
        format!("  through iceoryx2 alone:  {}", times(floor)),
    ]
}

fn judgement(verdict: &Verdict) -> String {
    use lobula_core::simulation::Label;
    let removed = |label: Label| {
        100.0 - 100.0 * verdict.kept.get(label) as f64 / (verdict.raw.get(label) as f64).max(1.0)
    };
    format!(
        "signal kept {:.1} %, noise removed {:.1} % (leak {:.1}, shot {:.1}, hot {:.1})",
        verdict.signal_kept(),
        verdict.noise_removed(),
        removed(Label::Leak),
        removed(Label::Shot),
        removed(Label::Hot),
    )
}

fn times(times: Percentiles) -> String {
    format!("p50 {}, p99 {}, p99.9 {}", duration(times.p50), duration(times.p99), duration(times.p999))
}

/// Space between the two planes.
const GAP: u16 = 2;

/// Both planes as half blocks, under their names, in at most so many columns and rows.
fn side_by_side(picture: &Picture, columns: u16, rows: u16, paint: Paint) -> Vec<String> {
    let width = usize::from(columns.saturating_sub(GAP) / 2).min(120);
    // Half blocks are about square; 16:9 is the usual sensor.
    let height = (width * 9 / 16 / 2).min(rows.saturating_sub(1).into());
    if width < 8 || height < 4 {
        return Vec::new();
    }
    let planes = [&picture.raw, &picture.filtered].map(|plane| plane.cells(width, 2 * height));
    let mut lines = vec![format!(
        "{:<pad$}{}",
        "raw, as the camera sends it",
        "filtered, as clients get it",
        pad = width + usize::from(GAP)
    )];
    for row in 0..height {
        let mut text = Text::default();
        for (i, cells) in planes.iter().enumerate() {
            if i > 0 {
                text.put(ResetColor);
                text.put(Print(" ".repeat(GAP.into())));
            }
            let half = |half: usize| cells.chunks(width).nth(2 * row + half).unwrap_or_default();
            text.half_blocks(half(0), half(1), paint);
        }
        lines.push(text.0);
    }
    lines
}

/// Text with commands to the terminal in it.
#[derive(Default)]
struct Text(String);

impl Text {
    fn put(&mut self, command: impl Command) {
        // Writing to a string cannot fail.
        let _ = command.write_ansi(&mut self.0);
    }

    fn half_blocks(&mut self, upper: &[Colour], lower: &[Colour], paint: Paint) {
        let mut last = None;
        for colours in upper.iter().zip(lower) {
            if last.replace(colours) != Some(colours) {
                self.put(SetForegroundColor(paint.colour(*colours.0)));
                self.put(SetBackgroundColor(paint.colour(*colours.1)));
            }
            self.put(Print('▀'));
        }
    }
}

impl Paint {
    fn colour(self, [r, g, b]: Colour) -> Color {
        match self {
            Self::True => Color::Rgb { r, g, b },
            // The 24 greys of the 256 colours where it is dim, since their 6x6x6 cube starts at bright.
            Self::Indexed if r.max(g).max(b) < 120 => {
                let grey = (r as u16 + g as u16 + b as u16) / 3;
                Color::AnsiValue(232 + (grey.saturating_sub(8) / 10) as u8)
            }
            Self::Indexed => {
                let level = |part: u8| if part < 48 { 0 } else { ((part as u16 - 35) / 40) as u8 };
                Color::AnsiValue(16 + 36 * level(r) + 6 * level(g) + level(b))
            }
        }
    }
}

/// A line cut to so many characters, where it has no colours; pictures are as wide as they should be.
fn cut(line: &str, columns: usize) -> String {
    if line.contains('\x1b') {
        return line.to_owned();
    }
    line.chars().take(columns).collect()
}
