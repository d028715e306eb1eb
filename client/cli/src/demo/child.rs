//! Processes of the demo: this same program, ended and reaped with it.

use crate::Failure;
use lobula_client::{Client, ClientOptions, Error, Root};
use std::ffi::OsStr;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child as Process, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// This program; where an interpreter runs it, the script that was called.
fn program() -> PathBuf {
    let exe = std::env::current_exe().unwrap_or_default();
    let is_lobula = exe.file_stem().is_some_and(|name| name.to_string_lossy().starts_with("lobula"));
    match std::env::args_os().next() {
        Some(script) if !is_lobula => script.into(),
        _ => exe,
    }
}

/// A signal that the demo sends.
#[derive(Clone, Copy, Debug)]
pub enum Signal {
    /// Stops a process where it is.
    Stop,
    /// Lets it go on.
    Continue,
}

/// A process that ends with this value: killed if need be, and reaped, since one that is not looks alive to iceoryx2.
#[derive(Debug)]
pub struct Child {
    process: Process,
    name: &'static str,
    log: PathBuf,
    kept: bool,
}

impl Child {
    /// Starts this program with `args`; what it says on stderr goes to a file in `folder`.
    pub fn start<S: AsRef<OsStr>>(
        name: &'static str,
        folder: &Path,
        args: impl IntoIterator<Item = S>,
    ) -> Result<Self, Failure> {
        let log = folder.join(format!("{name}.log"));
        let open = || File::options().create(true).append(true).open(&log);
        let failed = |error| Failure::general(format!("cannot start {name}: {error}"));
        let process = Command::new(program())
            .args(args)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(open().map_err(failed)?)
            .spawn()
            .map_err(failed)?;
        Ok(Self { process, name, log, kept: false })
    }

    /// Its process id.
    pub fn pid(&self) -> u32 {
        self.process.id()
    }

    /// What it prints, once.
    pub fn stdout(&mut self) -> Option<ChildStdout> {
        self.process.stdout.take()
    }

    /// What it reads, once; dropped, its input ends.
    pub fn stdin(&mut self) -> Option<ChildStdin> {
        self.process.stdin.take()
    }

    /// Sends a signal.
    #[allow(unsafe_code)] // std sends no signal but SIGKILL
    pub fn signal(&self, signal: Signal) {
        let number = match signal {
            Signal::Stop => libc::SIGSTOP,
            Signal::Continue => libc::SIGCONT,
        };
        // SAFETY: kill takes two numbers; the process is our child and not reaped, so the id is still its own.
        unsafe { libc::kill(self.process.id() as libc::pid_t, number) };
    }

    /// Kills it at once, as a crash would, and reaps it.
    pub fn kill(&mut self) {
        self.end();
    }

    /// Leaves it running when this process ends.
    pub fn keep(mut self) {
        self.kept = true;
    }

    /// Waits for its end.
    pub fn wait(&mut self, within: Duration) -> Result<ExitStatus, Failure> {
        let deadline = Instant::now() + within;
        loop {
            match self.process.try_wait() {
                Ok(Some(status)) => return Ok(status),
                Ok(None) if Instant::now() < deadline => sleep(Duration::from_millis(5)),
                _ => return Err(self.failure("did not end in time")),
            }
        }
    }

    /// Connects to the daemon that this process is to be; if it ends instead, it says why better than a client that
    /// found none.
    pub fn connect(&mut self, root: &Root, within: Duration) -> Result<Client, Failure> {
        let deadline = Instant::now() + within;
        let options = ClientOptions::default().root(root.clone()).name("demo");
        loop {
            match Client::connect(options.clone()) {
                Err(Error::NoDaemon { .. }) if Instant::now() < deadline => sleep(Duration::from_millis(10)),
                result => return Ok(result?),
            }
            self.check()?;
        }
    }

    /// Fails if it has ended.
    pub fn check(&mut self) -> Result<(), Failure> {
        match self.process.try_wait() {
            Ok(None) => Ok(()),
            _ => Err(self.failure("ended by itself")),
        }
    }

    /// What went wrong with it, and its last words.
    pub fn failure(&self, what: &str) -> Failure {
        let log = std::fs::read_to_string(&self.log).unwrap_or_default();
        let words = log.lines().last().unwrap_or("it said nothing");
        Failure::general(format!("{} (pid {}) {what}: {words}", self.name, self.pid()))
    }

    fn end(&mut self) {
        // Both fail only where it has ended already.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        if !self.kept {
            self.end();
        }
    }
}
