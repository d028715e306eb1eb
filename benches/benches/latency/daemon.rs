//! A daemon with a synthetic camera, which tells its allocations when asked.

use std::collections::BTreeMap;
use std::io::BufRead;

use lobula_client::{Client, ClientOptions, Root};
use lobula_core::chain::{Spec, ViewSpec};
use lobula_core::representation::Kind;
use lobula_core::simulation::SceneSpec;
use lobulad::Daemon;
use lobulad::config::Config;
use lobulad::source::SourceSpec;
use serde::{Deserialize, Serialize};

use crate::{Outcome, allocations, number};

/// What the daemon has done by a moment.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Mark {
    /// Allocations by name of thread.
    pub allocations: BTreeMap<String, u64>,
    /// Packets published, heartbeats included: each took one loan.
    pub packets: u64,
    /// Windows published, of all views: each took one loan.
    pub windows: u64,
    /// Packets that the views did not get since they were behind.
    pub views_missed: u64,
    /// Packets of the source that were taken over 10 ms late.
    pub behind: u64,
}

/// Work of the pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Every event passes, no views.
    Bare,
    /// The default chain and two views.
    Full,
}

impl Work {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Bare, Self::Full];

    /// In reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bare => "no filter, no view",
            Self::Full => "default chain, two views",
        }
    }
}

/// Arguments of the role.
pub fn args(root: &Root, rate_evs: u32, work: Work) -> Vec<String> {
    vec![root.to_string(), rate_evs.to_string(), u8::from(work == Work::Full).to_string()]
}

/// Serves until its input ends. Says a line when ready, and a [`Mark`] for each line it is told.
pub fn role(args: &[String]) -> Outcome<()> {
    lobulad::die_with_parent();
    let root = Root::new(args.first().ok_or("no root")?)?;
    let daemon = Daemon::start(&config(&root, number(args, 1)?, number::<u8>(args, 2)? == 1))?;
    println!("ready");
    let client = Client::connect(ClientOptions::default().root(root).name("latency-marks"))?;
    for line in std::io::stdin().lock().lines() {
        line?;
        let allocations = allocations::by_thread();
        let status = client.status()?;
        let windows = status.views.iter().map(|view| view.published).sum();
        let (packets, views_missed, behind) = (status.packets, status.views_missed, status.behind);
        let mark = Mark { allocations, packets, windows, views_missed, behind };
        println!("{}", serde_json::to_string(&mark)?);
    }
    drop(client);
    daemon.stop();
    daemon.join();
    Ok(())
}

fn config(root: &Root, rate_evs: u32, full: bool) -> Config {
    let mut config = Config::default();
    config.instance.root = Some(root.path().to_owned());
    config.camera.source = SourceSpec::Synthetic(SceneSpec { rate_evs, ..SceneSpec::default() });
    if full {
        config.filters = Spec::standard();
        config.views = vec![
            ViewSpec::new("histogram", Kind::PolarityHistogram, 20_000),
            ViewSpec::new("surface", Kind::TimeSurface, 20_000),
        ];
    }
    config
}
