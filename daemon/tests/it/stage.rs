//! What the tests act on: an instance of its own, daemons in threads or processes, and clients that keep accounts.

use lobula_client::{Client, ClientOptions, EventSubscriber, Packet, PacketHeader, Root, SubscribeOptions};
use lobulad::Daemon;
use lobulad::config::{self, Config};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use tempfile::TempDir;

/// Long enough for a loaded machine; a test that waits so long has failed.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// An instance in a directory of its own.
pub struct Stage {
    folder: TempDir,
}

impl Stage {
    pub fn new() -> Self {
        Self { folder: tempfile::Builder::new().prefix("lobula-t").tempdir_in("/dev/shm").unwrap() }
    }

    pub fn root(&self) -> Root {
        Root::new(self.folder.path().join("root")).unwrap()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn config(&self, text: &str) -> Config {
        let mut config = config::parse(text).unwrap();
        config.instance.root = Some(self.root().path().to_owned());
        config
    }

    /// A daemon in threads of this process.
    pub fn daemon(&self, text: &str) -> Daemon {
        Daemon::start(&self.config(text)).unwrap()
    }

    /// A daemon in a process of its own, which serves when this returns.
    pub fn process(&self, text: &str) -> Process {
        let path = self.path("lobulad.toml");
        std::fs::write(&path, text).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_lobulad"))
            .arg("--config")
            .arg(&path)
            .arg("--root")
            .arg(self.root().path())
            .arg("--die-with-parent")
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let process = Process { child };
        // A daemon killed before leaves its socket, which answers nobody: the pid tells who does.
        let pid = process.child.id();
        wait_until(|| Client::connect(self.options()).is_ok_and(|client| client.hello().pid == pid));
        process
    }

    pub fn options(&self) -> ClientOptions {
        ClientOptions::default().root(self.root()).name("test")
    }

    pub fn client(&self) -> Client {
        Client::connect_within(self.options(), PATIENCE).unwrap()
    }

    pub fn events(&self) -> EventSubscriber {
        self.client().events(SubscribeOptions::default()).unwrap()
    }
}

/// Waits until something is so, with a deadline no loaded machine needs.
pub fn wait_until(mut so: impl FnMut() -> bool) {
    let start = std::time::Instant::now();
    while !so() {
        assert!(start.elapsed() < PATIENCE, "never came to be");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Sends a signal to a child that has not been reaped.
#[allow(unsafe_code)] // std can only kill
pub fn signal(child: &Child, signal: libc::c_int) {
    // SAFETY: kill touches no memory; the child is ours and not reaped, so that its number is not another's.
    assert_eq!(unsafe { libc::kill(child.id() as libc::pid_t, signal) }, 0);
}

/// A child process, killed and reaped at the end.
pub struct Process {
    pub child: Child,
}

impl Process {
    pub fn signal(&self, signal: libc::c_int) {
        self::signal(&self.child, signal);
    }

    pub fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
    }
}

/// A client's books of one generation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Books {
    pub generation: u64,
    /// Published before the first packet received.
    pub joined_at: u64,
    pub delivered: u64,
    pub lost: u64,
    pub packets: u64,
    /// Published up to the last packet received.
    pub published: u64,
}

impl Books {
    /// Enters a packet. The header's ledgers must be exact, and so must the sums.
    pub fn enter(&mut self, packet: &Packet) {
        let header: &PacketHeader = packet.header();
        assert!(header.bytes.is_exact(), "{header:?}");
        assert!(header.events.is_exact(), "{header:?}");
        assert_eq!(header.count as usize, packet.len());
        assert_eq!(header.events.published, header.published_before + u64::from(header.count));
        if self.generation != header.generation {
            *self =
                Self { generation: header.generation, joined_at: header.published_before, ..Self::default() };
        }
        self.delivered += packet.len() as u64;
        self.lost += packet.lost_before();
        self.packets += 1;
        self.published = header.events.published;
        assert_eq!(self.published - self.joined_at, self.delivered + self.lost, "{self:?}");
    }
}

/// A small recording in the folder, made by the synthetic camera.
pub fn recording(path: &Path, events: usize) -> String {
    use lobula_core::simulation::{Camera, Scene, SceneSpec};
    use lobula_core::{Geometry, wire::Encoding};
    let spec = SceneSpec { geometry: Geometry::new(320, 240), rate_evs: 1_000_000, ..SceneSpec::default() };
    let mut camera = Camera::new(&Scene::try_new(&spec).unwrap()).with_packet_us(events as u32);
    let mut bytes = vec![0; 64 + events * 8];
    let made = camera.next_packet(&mut bytes);
    bytes.truncate(made.bytes);
    let header = "% evt 3.0\n% format EVT3;height=240;width=320\n% geometry 320x240\n% end\n";
    std::fs::write(path, [header.as_bytes(), &bytes].concat()).unwrap();
    let recording = lobula_formats::open(path).unwrap();
    assert_eq!(recording.encoding(), Some(Encoding::Evt3));
    format!("{}", path.display())
}
