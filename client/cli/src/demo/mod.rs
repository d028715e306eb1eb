//! `lobula demo`: the main job, proved on screen with real processes.
//!
//! ```text
//!  this process: script, screen, a client for the picture
//!    ├─ serve        the daemon, killed and started again     raw bytes ─▶ decode ─▶ filter ─▶ shared memory
//!    ├─ demo-reader  "steady": never stopped
//!    ├─ demo-reader  "second": stopped for a while
//!    ├─ demo-floor   two ends of iceoryx2 alone, before
//!    └─ serve, echo  a lossless replay, after
//! ```
//!
//! Nothing on screen comes from the daemon's word alone: readers count what they got, labels come from the scene's
//! spec, and the digest of the replay is compared with one made offline.

mod book;
mod child;
pub mod floor;
mod live;
mod percentiles;
mod picture;
mod plan;
pub mod reader;
mod replay;
mod report;
mod screen;
mod truth;
mod viewer;

use crate::Failure;
use crate::args::DemoArgs;
use live::Live;
use plan::Plan;
use report::Summary;
use screen::Screen;

/// Runs the demo. It fails where a sum is not exact or a digest differs, whatever was seen before.
pub fn run(args: &DemoArgs) -> Result<(), Failure> {
    // A signal must not leave processes and memory behind.
    lobulad::catch_signals();
    let result = play(args);
    // What fails then fails since all processes of the terminal were told to end.
    if lobulad::end_asked() { Err(Failure::new(Failure::INTERRUPTED, "ended by a signal")) } else { result }
}

fn play(args: &DemoArgs) -> Result<(), Failure> {
    let mut screen = Screen::new(args);
    screen.say(match args.input {
        None => "rendering the scene and learning its hot pixels",
        Some(_) => "looking at the recording",
    })?;
    let plan = Plan::new(args)?;
    screen.say("measuring the floor: iceoryx2 alone, between two processes")?;
    let floor = floor::measure(&plan)?;
    let mut live = Live::start(&plan, floor)?;
    live.run(&mut screen)?;
    let png = plan.png();
    live.save_picture(&png)?;
    let outcome = live.finish(args.keep)?;
    screen.say("replaying the same bytes, lossless")?;
    let replay = replay::run(&plan)?;
    let summary = Summary::new(&outcome, floor, &replay, &png);
    screen.end(&outcome, &replay, &summary)?;
    report::verdict(&outcome, &replay)
}
