//! The synthetic camera: a scene made once, as EVT3 bytes, replayed for ever with its time moved on.

use super::{Source, SourceError, Transfer};
use lobula_core::Geometry;
use lobula_core::simulation::{Camera, Scene, SceneSpec};
use lobula_core::wire::Encoding;

/// A synthetic camera.
pub(super) struct Synthetic {
    camera: Camera,
    rate_evs: u32,
    seed: u64,
}

impl Synthetic {
    pub(super) fn new(spec: &SceneSpec) -> Result<Self, SourceError> {
        let scene = Scene::try_new(spec).map_err(|error| SourceError::Settings(error.to_string()))?;
        Ok(Self { camera: Camera::new(&scene), rate_evs: spec.rate_evs, seed: spec.seed })
    }
}

impl Source for Synthetic {
    fn encoding(&self) -> Encoding {
        Encoding::Evt3
    }

    fn geometry(&self) -> Geometry {
        self.camera.geometry()
    }

    fn describe(&self) -> String {
        let mevs = f64::from(self.rate_evs) / 1e6;
        format!("synthetic camera {}, {mevs} Mev/s, seed {}", self.geometry(), self.seed)
    }

    fn read(&mut self, out: &mut [u8]) -> Result<Transfer, SourceError> {
        let packet = self.camera.next_packet(out);
        Ok(Transfer { bytes: packet.bytes, due_ns: Some(packet.t_end_us * 1000), ..Transfer::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packets_are_due_every_millisecond() {
        let spec = SceneSpec { geometry: Geometry::new(64, 48), ..SceneSpec::default() };
        let mut source = Synthetic::new(&spec).unwrap();
        let mut out = vec![0; 1 << 16];
        let due: Vec<_> = (0..3).map(|_| source.read(&mut out).unwrap().due_ns).collect();
        assert_eq!(due, [Some(1_000_000), Some(2_000_000), Some(3_000_000)]);
    }

    #[test]
    fn impossible_scenes_are_refused_with_what_to_do() {
        let spec = SceneSpec { rate_evs: 1, ..SceneSpec::default() };
        let error = Synthetic::new(&spec).err().unwrap().to_string();
        assert!(error.contains("give 10000 to 50000000"), "{error}");
    }
}
