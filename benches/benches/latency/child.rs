//! A process of this program in another role, spoken to in lines.

use std::io::{BufRead, BufReader, Lines, Write};
use std::process::{Child, ChildStdout, Command, Stdio};

use crate::Outcome;

/// The process; killed and reaped with the value.
pub struct Role {
    name: String,
    child: Child,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Role {
    /// Starts the role with its arguments.
    pub fn start(name: &str, args: &[String]) -> Outcome<Self> {
        let mut command = Command::new(std::env::current_exe()?);
        command.arg(name).args(args).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn()?;
        let lines = BufReader::new(child.stdout.take().ok_or("no output")?).lines();
        Ok(Self { name: name.to_owned(), child, lines })
    }

    /// The next line it says.
    pub fn line(&mut self) -> Outcome<String> {
        let line = self.lines.next().ok_or_else(|| format!("{} ended before it was done", self.name))?;
        Ok(line?)
    }

    /// Says a line to it, and waits for its answer.
    pub fn ask(&mut self, question: &str) -> Outcome<String> {
        if let Some(input) = &mut self.child.stdin {
            writeln!(input, "{question}")?;
        }
        self.line()
    }

    /// Closes its input, which tells it to end, and waits until it has.
    pub fn end(mut self) -> Outcome<()> {
        drop(self.child.stdin.take());
        self.child.wait()?;
        Ok(())
    }
}

impl Drop for Role {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
