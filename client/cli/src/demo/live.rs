//! The live part: daemon, two readers, and what is done to them.

use super::child::{Child, Signal};
use super::percentiles::Percentiles;
use super::plan::Plan;
use super::reader::Report;
use super::screen::{Frame, ReaderLine, Screen};
use super::viewer::{Verdict, Viewer};
use crate::Failure;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::ChildStdin;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long anything may take that waits for another process, on a machine that is busy with other things.
const PATIENCE: Duration = Duration::from_secs(120);
/// Time between two looks at the script, and two frames.
const TICK: Duration = Duration::from_millis(100);

/// A reader process, as the demo sees it.
struct Reader {
    name: &'static str,
    child: Child,
    input: Option<ChildStdin>,
    report: Arc<Mutex<Report>>,
    listener: Option<JoinHandle<()>>,
    state: &'static str,
}

/// The processes of the live part.
pub struct Live<'a> {
    plan: &'a Plan,
    floor: Percentiles,
    daemon: Child,
    viewer: Viewer,
    readers: [Reader; 2],
    caption: &'static str,
    start: Instant,
}

/// What is left when all has ended.
pub struct Outcome {
    /// Of the reader that was never stopped, and of the other.
    pub reports: [Report; 2],
    /// Process ids of both.
    pub reader_pids: [u32; 2],
    /// Process id of the last daemon.
    pub daemon_pid: u32,
    /// What the filter did; nothing of a recording, whose noise nobody knows.
    pub verdict: Option<Verdict>,
    /// The instance, if its daemon was left running.
    pub kept: Option<String>,
}

impl<'a> Live<'a> {
    /// Starts all processes.
    pub fn start(plan: &'a Plan, floor: Percentiles) -> Result<Self, Failure> {
        let mut daemon = start_daemon(plan)?;
        let viewer = Viewer::open(daemon.connect(&plan.root, PATIENCE)?, plan.exposure_us())?;
        let readers = [Reader::start(plan, "steady")?, Reader::start(plan, "second")?];
        let (caption, start) = ("", Instant::now());
        Ok(Self { plan, floor, daemon, viewer, readers, caption, start })
    }

    /// Does to them what there is to show.
    pub fn run(&mut self, screen: &mut Screen) -> Result<(), Failure> {
        self.caption = "clients connect";
        self.until(screen, |live| live.readers.iter().all(|reader| reader.generations() >= 1))?;
        self.caption = "both clients read";
        self.stay(screen, 0.30)?;
        self.caption = "the second client is stopped (SIGSTOP): the other loses nothing";
        self.readers[1].signal(Signal::Stop);
        self.stay(screen, 0.15)?;
        self.caption = "the second client goes on, and knows what it has lost";
        self.readers[1].signal(Signal::Continue);
        self.stay(screen, 0.15)?;
        self.caption = "the daemon was killed (SIGKILL) and starts again under both clients";
        self.restart_daemon()?;
        self.until(screen, |live| live.readers.iter().all(|reader| reader.generations() >= 2))?;
        self.caption = "both clients went on by themselves";
        self.stay(screen, 0.40)
    }

    /// Writes the last picture.
    pub fn save_picture(&mut self, path: &Path) -> Result<(), Failure> {
        let picture = self.viewer.picture.as_ref();
        picture.ok_or_else(|| Failure::general("no picture was taken: nothing came in time"))?.save(path)
    }

    /// Ends readers and daemon, in this order, and keeps what they counted.
    pub fn finish(self, keep: bool) -> Result<Outcome, Failure> {
        let [steady, second] = self.readers;
        let reader_pids = [steady.child.pid(), second.child.pid()];
        let reports = [steady.finish()?, second.finish()?];
        let mut daemon = self.daemon;
        let daemon_pid = daemon.pid();
        daemon.check()?;
        if keep {
            daemon.keep();
        } else {
            self.viewer.stop_daemon()?;
            daemon.wait(PATIENCE)?;
        }
        let verdict = self.plan.truth.scene().is_some().then_some(self.viewer.verdict);
        let kept = keep.then(|| self.plan.root.to_string());
        Ok(Outcome { reports, reader_pids, daemon_pid, verdict, kept })
    }

    fn restart_daemon(&mut self) -> Result<(), Failure> {
        // The old one must be reaped before the new one starts, or its memory would not be cleaned up.
        self.daemon.kill();
        self.daemon = start_daemon(self.plan)?;
        Ok(())
    }

    /// Goes on for a share of the live time.
    fn stay(&mut self, screen: &mut Screen, share: f64) -> Result<(), Failure> {
        let end = Instant::now() + self.plan.live.mul_f64(share);
        while Instant::now() < end {
            self.tick(screen, end)?;
        }
        Ok(())
    }

    /// Goes on until something has come about.
    fn until(&mut self, screen: &mut Screen, done: impl Fn(&Self) -> bool) -> Result<(), Failure> {
        let deadline = Instant::now() + PATIENCE;
        while !done(self) {
            if Instant::now() > deadline {
                return Err(Failure::general(format!(
                    "{}: that took longer than {PATIENCE:?}",
                    self.caption
                )));
            }
            self.tick(screen, deadline)?;
        }
        Ok(())
    }

    fn tick(&mut self, screen: &mut Screen, end: Instant) -> Result<(), Failure> {
        if lobulad::end_asked() {
            return Err(Failure::general("ended by a signal"));
        }
        let until = (Instant::now() + TICK).min(end);
        self.viewer.pump(&self.plan.truth, until)?;
        // Without a daemon there is nothing to wait in.
        std::thread::sleep(until.saturating_duration_since(Instant::now()));
        self.daemon.check()?;
        for reader in &mut self.readers {
            reader.child.check()?;
        }
        screen.frame(&self.frame())
    }

    fn frame(&self) -> Frame<'_> {
        Frame {
            seconds: self.start.elapsed().as_secs_f64(),
            caption: self.caption,
            picture: self.viewer.picture.as_ref(),
            in_evs: self.viewer.rates.in_evs,
            out_evs: self.viewer.rates.out_evs,
            verdict: self.plan.truth.scene().map(|_| &self.viewer.verdict),
            floor: self.floor,
            daemon: (self.daemon.pid(), self.viewer.generations, self.viewer.is_connected()),
            readers: self.readers.each_ref().map(Reader::line),
        }
    }
}

fn start_daemon(plan: &Plan) -> Result<Child, Failure> {
    let args = plan.serve(&plan.source, &plan.root, "daemon")?;
    Child::start("daemon", plan.folder(), args)
}

impl Reader {
    fn start(plan: &Plan, name: &'static str) -> Result<Self, Failure> {
        let root = plan.root.to_string();
        let mut child = Child::start(name, plan.folder(), ["demo-reader", "--root", &root, "--name", name])?;
        let report = Arc::new(Mutex::new(Report::default()));
        let listener = child.stdout().map(|output| {
            let report = report.clone();
            std::thread::spawn(move || {
                for line in BufReader::new(output).lines().map_while(Result::ok) {
                    if let Ok(new) = serde_json::from_str(&line) {
                        *report.lock().unwrap_or_else(PoisonError::into_inner) = new;
                    }
                }
            })
        });
        let input = child.stdin();
        Ok(Self { name, child, input, report, listener, state: "reads" })
    }

    fn signal(&mut self, signal: Signal) {
        self.state = match signal {
            Signal::Stop => "STOPPED",
            Signal::Continue => "reads",
        };
        self.child.signal(signal);
    }

    fn report(&self) -> Report {
        self.report.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// How many generations of the daemon it has read from, beyond their first packet.
    fn generations(&self) -> usize {
        self.report().book.pages.len()
    }

    fn line(&self) -> ReaderLine {
        let report = self.report();
        let page = report.book.pages.last().copied().unwrap_or_default();
        let (name, state, latency) = (self.name, self.state, report.latency);
        ReaderLine { name, pid: self.child.pid(), state, page, latency }
    }

    /// Ends its input, and takes its last word.
    fn finish(mut self) -> Result<Report, Failure> {
        drop(self.input.take());
        let status = self.child.wait(PATIENCE)?;
        if let Some(listener) = self.listener.take() {
            // It ends with the output of a process that has ended.
            let _ = listener.join();
        }
        let report = self.report();
        if !status.success() || !report.last {
            return Err(self.child.failure("failed"));
        }
        Ok(report)
    }
}
