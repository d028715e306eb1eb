//! The configuration: one TOML, checked whole before anything is done. Unknown keys are errors, with a suggestion.

use crate::source::SourceSpec;
use lobula_core::Geometry;
use lobula_core::chain::{Chain, ChainCause, Spec, View, ViewSpec};
use lobula_core::filter::FilterError;
use lobula_core::simulation::SceneSpec;
use lobula_formats::HotPixels;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Everything a daemon is told.
///
/// ```
/// let config = lobulad::config::parse(r#"
///     [camera]
///     name = "front"
///     source = { kind = "synthetic", rate_evs = 2000000 }
///
///     [[filter]]
///     kind = "refractory"
///     dt_us = 1000
///
///     [[view]]
///     name = "surface"
///     kind = "time_surface"
///     period_us = 10000
/// "#)?;
/// assert_eq!(config.camera.name, "front");
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Where its shared memory lies.
    #[serde(default)]
    pub instance: InstanceConfig,
    /// The camera.
    #[serde(default)]
    pub camera: CameraConfig,
    /// Filters, first to last; none passes every event.
    #[serde(default, rename = "filter")]
    pub filters: Spec,
    /// Views that are always on.
    #[serde(default, rename = "view")]
    pub views: Vec<ViewSpec>,
}

/// Where an instance of the daemon lies.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstanceConfig {
    /// Directory of its shared memory and control socket; default `$LOBULA_ROOT`, else `/dev/shm/lobula-<uid>`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub root: Option<PathBuf>,
}

/// A camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraConfig {
    /// Its name in those of the services; default `cam0`.
    pub name: String,
    /// Where its bytes come from; default a synthetic camera of 1 Mev/s.
    pub source: SourceSpec,
    /// Longest stretch of stream time in a packet, in µs, 100 to 100000; default 1000.
    pub packet_us: u32,
}

impl Default for CameraConfig {
    fn default() -> Self {
        let source = SourceSpec::Synthetic(SceneSpec::default());
        Self { name: "cam0".into(), source, packet_us: 1000 }
    }
}

impl Config {
    /// Checks what no single field can tell; the error says what to do.
    fn check(&self) -> Result<(), String> {
        if self.camera.name.is_empty()
            || self.camera.name.len() > 32
            || !self.camera.name.chars().all(is_name)
        {
            let name = &self.camera.name;
            return Err(format!("camera.name = {name:?}: give 1 to 32 of the characters a-z, 0-9, _ and -"));
        }
        if !(100..=100_000).contains(&self.camera.packet_us) {
            return Err(format!("camera.packet_us = {}: give 100 to 100000", self.camera.packet_us));
        }
        for (i, view) in self.views.iter().enumerate() {
            if view.name.is_empty() || view.name.len() > 32 || !view.name.chars().all(is_name) {
                return Err(format!("view {i}: name = {:?}: give 1 to 32 of a-z, 0-9, _ and -", view.name));
            }
            if self.views.iter().skip(i + 1).any(|other| other.name == view.name) {
                return Err(format!("two views are named {:?}: give each a name of its own", view.name));
            }
        }
        // The size of the sensor is not known before the source is open, and settings must not depend on it: any will do.
        let any = Geometry::new(64, 64);
        if let Err(error) = Chain::try_new(&self.filters, any)
            && !depends_on_size(&error.cause)
        {
            return Err(error.to_string());
        }
        // Packets, heartbeats and windows keep the camera's time, so that nothing may give events another.
        if let Some((i, kind)) = self.filters.moves_time() {
            return Err(format!(
                "filter {i} ({kind}): a live stream keeps the camera's time: remove it, or convert a recording with it"
            ));
        }
        for view in &self.views {
            View::try_new(view, any).map_err(|error| format!("view {:?}: {error}", view.name))?;
        }
        if let SourceSpec::Synthetic(spec) = &self.camera.source {
            spec.check().map_err(|error| format!("camera.source: {error}"))?;
        }
        Ok(())
    }
}

/// Whether a stage could be made for a sensor of another size: only the real one tells.
fn depends_on_size(cause: &ChainCause) -> bool {
    matches!(
        cause,
        ChainCause::PixelOffSensor { .. }
            | ChainCause::OtherSensor { .. }
            | ChainCause::Filter(FilterError::RegionOffSensor { .. })
    )
}

fn is_name(c: char) -> bool {
    c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' || c == '-'
}

/// What the text says, unchecked.
fn read(text: &str) -> Result<Config, String> {
    let config: Config = toml::from_str(text).map_err(|error| {
        let line =
            error.span().map(|span| 1 + text.get(..span.start).unwrap_or_default().matches('\n').count());
        let place = line.map(|line| format!("line {line}: ")).unwrap_or_default();
        format!("{place}{}", suggest(error.message()))
    })?;
    Ok(config)
}

/// Reads a configuration. Files that it names are looked for from here.
///
/// # Errors
/// One sentence: what is wrong, where, and what to do.
pub fn parse(text: &str) -> Result<Config, String> {
    complete(read(text)?, Path::new(""))
}

/// Loads the files of hot pixels that the filters name, from `folder` on, and checks it all.
fn complete(mut config: Config, folder: &Path) -> Result<Config, String> {
    HotPixels::load_lists(&mut config.filters, folder).map_err(|error| error.to_string())?;
    config.check()?;
    Ok(config)
}

/// Reads the configuration at `path`. Files that it names are looked for from its folder.
///
/// # Errors
/// One sentence with the path.
pub fn load(path: &Path) -> Result<Config, String> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| format!("{}: {error}: give a readable TOML file", path.display()))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let config = read(&text).and_then(|config| complete(config, folder));
    config.map_err(|error| format!("{}: {error}", path.display()))
}

/// The parser's message on one line, and of the names it expects the one that was probably meant.
fn suggest(message: &str) -> String {
    let message = message.lines().collect::<Vec<_>>().join(", ");
    let unknown = message.starts_with("unknown field") || message.starts_with("unknown variant");
    let mut names = message.split('`').skip(1).step_by(2);
    let (Some(given), true) = (names.next(), unknown) else { return message };
    let nearest = names.min_by_key(|name| strsim::damerau_levenshtein(given, name));
    match nearest {
        Some(name) if strsim::damerau_levenshtein(given, name) <= 1 + given.len() / 3 => {
            format!("{message}: did you mean `{name}`?")
        }
        _ => message.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn refused(text: &str, parts: &[&str]) {
        let error = parse(text).expect_err("must be refused");
        assert!(!error.contains('\n'), "one line: {error}");
        for part in parts {
            assert!(error.contains(part), "{part:?} is not in: {error}");
        }
    }

    #[test]
    fn nothing_said_is_a_synthetic_camera() {
        assert_eq!(parse("").unwrap(), Config::default());
    }

    #[test]
    fn the_packaged_example_is_valid() {
        let config = parse(include_str!("../packaging/lobulad.toml")).unwrap();
        assert!(!config.filters.stages.is_empty() && config.views.len() == 2);
    }

    #[test]
    fn hot_pixels_are_read_from_a_file_beside_the_configuration() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        };
        let text = "[[filter]]\nkind = \"denoise\"\nhot_pixels = [[1, 2]]\nhot_pixels_file = \"front.txt\"\n";
        let config = write("lobulad.toml", text);
        let missing = load(&config).unwrap_err();
        assert!(missing.contains("front.txt: no such file"), "{missing}");
        write("front.txt", "# sensor 1280x720\n1279,719\n");
        let mut loaded = load(&config).unwrap();
        let list = loaded.filters.stages[0].hot_pixels_mut().unwrap();
        assert_eq!((&*list.pixels, &*list.file), (&vec![(1, 2), (1279, 719)], &None));
        assert_eq!(*list.sensor, Some((1280, 720)));
        write("front.txt", "# sensor 1280x720\n1280,719\n");
        let off = load(&config).unwrap_err();
        assert!(off.contains("line 2") && off.contains("1280,719"), "{off}");
    }

    #[test]
    fn hot_pixels_may_be_anywhere_on_the_real_sensor() {
        for text in [
            "[[filter]]\nkind = \"denoise\"\nhot_pixels = [[1279, 719]]",
            "[[filter]]\nkind = \"region_of_interest\"\nx = 640\ny = 0\nwidth = 640\nheight = 720",
            "[[filter]]\nkind = \"crop\"\nx = 640\ny = 0\nwidth = 640\nheight = 720",
        ] {
            assert!(parse(text).is_ok(), "{text}");
        }
    }

    #[test]
    fn mistakes_are_named_with_what_to_do() {
        refused("[camera]\nnane = \"front\"", &["line 2", "`nane`", "did you mean `name`?"]);
        refused("[camera]\nname = \"A b\"", &["camera.name", "a-z"]);
        refused("[camera]\npacket_us = 5", &["packet_us = 5", "100 to 100000"]);
        refused("[camera]\nsource = { kind = \"usb\" }", &["usb", "synthetic"]);
        refused("[camera]\nsource = { kind = \"synthetic\", rate_evs = 1 }", &["camera.source", "10000"]);
        refused("[[filter]]\nkind = \"refractoryy\"\ndt_us = 1", &["did you mean `refractory`?"]);
        refused("[[filter]]\nkind = \"refractory\"\ndt_us = 2000000000", &["filter 0", "refractory"]);
        refused("[[view]]\nname = \"v\"\nkind = \"voxel_grid\"\nperiod_us = 0", &["view \"v\"", "period_us"]);
        refused(
            "[[view]]\nname = \"v\"\nkind = \"count\"\nperiod_us = 33000\nstride_us = 2000",
            &["view \"v\"", "stride_us = 2000", "windows of 33000 µs"],
        );
        refused("[[filter]]\nkind = \"time_shift\"\ndt_us = 1", &["filter 0 (time_shift)", "camera's time"]);
        refused(
            "[[filter]]\nkind = \"crop\"\nx = 0\ny = 0\nwidth = 0\nheight = 1",
            &["filter 0 (crop)", "no pixel"],
        );
        let twice = "[[view]]\nname = \"v\"\nkind = \"count\"\nperiod_us = 9\n";
        refused(&format!("{twice}{twice}"), &["two views are named \"v\""]);
        refused("[camera\n", &["line 1"]);
    }
}
