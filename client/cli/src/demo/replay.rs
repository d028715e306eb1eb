//! The lossless replay: some bytes of the camera as a recording, through a daemon of their own to a client, and the
//! same recording offline through the same filters. Both digests must be equal.

use super::child::Child;
use super::plan::Plan;
use super::truth::Truth;
use crate::Failure;
use lobula_core::Transform;
use lobula_core::chain::Chain;
use lobula_core::simulation::{Camera, Scene};
use lobula_formats::Digest;
use lobulad::source::{FileSpec, SourceSpec};
use serde::Deserialize;
use std::fs::File;
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Most bytes of the camera that are replayed.
const BYTES_MAX: u64 = 8 << 20;
/// Most stream time of a scene that is replayed.
const SCENE_US_MAX: u64 = 1_000_000;
const PATIENCE: Duration = Duration::from_secs(60);

/// Two digests that must be equal.
#[derive(Debug)]
pub struct Replay {
    /// Events that were left after the filters.
    pub events: u64,
    /// Events the client lost: none, or it was not lossless.
    pub lost: u64,
    /// Of the events that a client received from the daemon.
    pub sha256_live: String,
    /// Of the events read from the file, filtered here.
    pub sha256_offline: String,
}

impl Replay {
    /// Whether live is offline, and nothing was lost.
    pub fn is_equal(&self) -> bool {
        self.sha256_live == self.sha256_offline && self.lost == 0
    }
}

/// What `lobula echo events --digest --json` prints.
#[derive(Deserialize)]
struct Echo {
    events: u64,
    lost: u64,
    sha256: String,
}

/// Replays and compares.
pub fn run(plan: &Plan) -> Result<Replay, Failure> {
    let path = plan.folder().join("replay.raw");
    let written = match &plan.truth {
        Truth::Scene(scene) => write_scene(&path, scene),
        Truth::Recording(recording, _) => copy_start(recording.path(), &path),
    };
    written.map_err(|error| Failure::general(format!("{}: {error}", path.display())))?;
    let echo = live(plan, &path)?;
    let (events, sha256_offline) = offline(plan, &path)?;
    // The folder outlives a demo that keeps its daemon; what fails here harms nobody.
    let _ = std::fs::remove_file(&path);
    if events != echo.events {
        return Err(Failure::general(format!("live gave {} events and offline {events}", echo.events)));
    }
    Ok(Replay { events, lost: echo.lost, sha256_live: echo.sha256, sha256_offline })
}

fn write_scene(path: &Path, scene: &Scene) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    let geometry = scene.geometry();
    let (width, height) = (geometry.width, geometry.height);
    write!(
        file,
        "% evt 3.0\n% format EVT3;height={height};width={width}\n% geometry {width}x{height}\n% end\n"
    )?;
    let mut camera = Camera::new(scene);
    let mut bytes = vec![0; 1 << 16];
    let mut written = 0;
    loop {
        let packet = camera.next_packet(&mut bytes);
        file.write_all(bytes.get(..packet.bytes).unwrap_or_default())?;
        written += packet.bytes as u64;
        if packet.t_end_us >= SCENE_US_MAX || written >= BYTES_MAX {
            return file.flush();
        }
    }
}

fn copy_start(from: &Path, to: &Path) -> std::io::Result<()> {
    std::io::copy(&mut File::open(from)?.take(BYTES_MAX), &mut File::create(to)?)?;
    Ok(())
}

fn live(plan: &Plan, path: &Path) -> Result<Echo, Failure> {
    let root = plan.root_of("replay")?;
    let source = SourceSpec::File(FileSpec { lossless: true, ..FileSpec::new(path) });
    let mut daemon = Child::start("replay", plan.folder(), plan.serve(&source, &root, "replay")?)?;
    let client = daemon.connect(&root, PATIENCE)?;
    let root_arg: PathBuf = root.path().into();
    let args = ["echo", "events", "--digest", "--json", "--root"].map(PathBuf::from);
    let mut echo = Child::start("echo", plan.folder(), args.into_iter().chain([root_arg]))?;
    let mut text = String::new();
    let mut output = echo.stdout().ok_or_else(|| echo.failure("has no output"))?;
    output.read_to_string(&mut text).map_err(Failure::general)?;
    if !echo.wait(PATIENCE)?.success() {
        return Err(echo.failure("failed"));
    }
    client.stop()?;
    daemon.wait(PATIENCE)?;
    serde_json::from_str(&text).map_err(Failure::general)
}

fn offline(plan: &Plan, path: &Path) -> Result<(u64, String), Failure> {
    let recording = lobula_formats::open(path)?;
    let mut chain = Chain::try_new(&plan.filters, recording.sensor_size()?).map_err(Failure::general)?;
    let (mut digest, mut events) = (Digest::default(), 0);
    let mut blocks = recording.blocks();
    while let Some(mut chunk) = blocks.next_block()? {
        chain.apply(&mut chunk.block).map_err(Failure::general)?;
        let span = chunk.block.span();
        events += span.events.len() as u64;
        digest.update(span);
    }
    Ok((events, digest.finish()))
}
