//! What the demo will do: the camera, the filters, where files lie, how long each part takes.

use super::truth::Truth;
use crate::Failure;
use crate::args::DemoArgs;
use lobula_client::Root;
use lobula_core::chain::{DenoiseSpec, Spec, StageSpec};
use lobula_core::simulation::{Scene, SceneSpec};
use lobulad::config::{CameraConfig, Config, InstanceConfig};
use lobulad::source::{FileSpec, SourceSpec};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What the demo will do.
#[derive(Debug)]
pub struct Plan {
    /// Where the raw events come from.
    pub source: SourceSpec,
    /// What is true of them.
    pub truth: Truth,
    /// What the daemon filters with.
    pub filters: Spec,
    /// Files that go with the demo.
    folder: PathBuf,
    /// Instance of the live daemon.
    pub root: Root,
    /// How long the live part takes, waiting aside.
    pub live: Duration,
    /// Packets with which the floor is measured, one a ms.
    pub floor_packets: u64,
    /// Rate of the camera, where it is known beforehand.
    pub rate_evs: Option<u32>,
    keep: bool,
}

/// Events of a neighbour this long ago support an event at 1 Mev/s; slower scenes need longer.
const SUPPORT_US: u64 = 10_000;

impl Plan {
    /// Renders the scene, or looks at the recording.
    pub fn new(args: &DemoArgs) -> Result<Self, Failure> {
        remove_stale_roots();
        let (source, truth, filters, rate_evs) = match &args.input {
            Some(path) => recording(args, path)?,
            None => synthetic(args.rate.0)?,
        };
        let folder = std::env::temp_dir().join(format!("lobula-demo-{}", std::process::id()));
        std::fs::create_dir_all(&folder)
            .map_err(|error| Failure::general(format!("{}: {error}", folder.display())))?;
        Ok(Self {
            source,
            truth,
            filters,
            folder,
            root: Root::new(format!("{ROOTS}{}", std::process::id()))?,
            live: Duration::from_secs_f64(args.seconds * 0.75),
            floor_packets: (args.seconds * 100.0).clamp(100.0, 3000.0) as u64,
            rate_evs,
            keep: args.keep,
        })
    }

    /// Where files of the demo lie.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Where the picture goes; it outlives the demo.
    pub fn png(&self) -> PathBuf {
        self.folder.with_extension("png")
    }

    /// Stream time that a picture shows: enough events to see, not so many that motion smears.
    pub fn exposure_us(&self) -> u64 {
        25_000 * 1000 / u64::from(self.rate_evs.unwrap_or(1_000_000)).isqrt().max(1)
    }

    /// Another instance of the demo.
    pub fn root_of(&self, part: &str) -> Result<Root, Failure> {
        Ok(Root::new(format!("{}-{part}", self.root))?)
    }

    /// The arguments that serve `source` in `root`.
    pub fn serve(&self, source: &SourceSpec, root: &Root, name: &str) -> Result<Vec<PathBuf>, Failure> {
        let config = Config {
            instance: InstanceConfig { root: Some(root.path().to_owned()) },
            camera: CameraConfig { source: source.clone(), ..CameraConfig::default() },
            filters: self.filters.clone(),
            views: Vec::new(),
        };
        let path = self.folder.join(format!("{name}.toml"));
        let text = toml::to_string(&config).map_err(Failure::general)?;
        std::fs::write(&path, text)
            .map_err(|error| Failure::general(format!("{}: {error}", path.display())))?;
        let mut args: Vec<PathBuf> = vec!["serve".into(), "--config".into(), path];
        if !self.keep || *root != self.root {
            args.push("--die-with-parent".into());
        }
        Ok(args)
    }
}

impl Drop for Plan {
    fn drop(&mut self) {
        if !self.keep {
            // What is left of them harms nobody; the next demo looks again.
            let _ = std::fs::remove_dir_all(self.root.path());
            let _ = std::fs::remove_dir_all(&self.folder);
        }
    }
}

type Input = (SourceSpec, Truth, Spec, Option<u32>);

fn synthetic(rate_evs: u32) -> Result<Input, Failure> {
    let spec = SceneSpec { rate_evs, ..SceneSpec::default() };
    let scene = Scene::try_new(&spec).map_err(Failure::general)?;
    // Speed grows with the root of the rate: so does the time in which an edge reaches the next pixel shrink.
    let support_us = (SUPPORT_US * 1000 / u64::from(rate_evs).isqrt()) as u32;
    let truth = Truth::Scene(Box::new(scene));
    let hot_pixels = truth.hot_pixels()?;
    let denoise = DenoiseSpec { support_us, shift: 3, hot_pixels, ..DenoiseSpec::default() };
    let filters = Spec { stages: vec![StageSpec::Denoise(denoise)] };
    Ok((SourceSpec::Synthetic(spec), truth, filters, Some(rate_evs)))
}

fn recording(args: &DemoArgs, path: &Path) -> Result<Input, Failure> {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let recording = lobula_formats::open(&path)?;
    recording.sensor_size()?;
    let truth = Truth::recording(recording)?;
    // A recording that is over before the demo is plays again, else there would be nothing to see.
    let looped = args.looped || truth.duration_us() as f64 / 1e6 < args.seconds * args.speed;
    let spec = FileSpec { speed: args.speed, looped, ..FileSpec::new(path) };
    Ok((SourceSpec::File(spec), truth, Spec::standard(), None))
}

const ROOTS: &str = "/dev/shm/lobula-demo-";

/// Removes what demos that were killed have left in memory.
fn remove_stale_roots() {
    let Ok(entries) = std::fs::read_dir("/dev/shm") else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        let pid =
            path.to_str().and_then(|path| path.strip_prefix(ROOTS)).and_then(|rest| rest.split('-').next());
        let is_stale = pid.is_some_and(|pid| !Path::new("/proc").join(pid).exists());
        // A daemon that was kept outlives its demo, and answers.
        let is_kept = std::os::unix::net::UnixStream::connect(path.join("control.sock")).is_ok();
        if is_stale && !is_kept {
            let _ = std::fs::remove_dir_all(path);
        }
    }
}
