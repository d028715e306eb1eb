//! What a camera's identifiers say where a header says no more: one table, with its sources.
//!
//! `openeb`: numbers in hal_psee_plugins/include/devices/utils/device_system_id.h, sizes in
//! hal_psee_plugins/src/boards/rawfile/psee_raw_file_header.cpp and, before Metavision 4, in
//! boards/rawfile/raw_constants.h (by plugin). `headers`: recordings that name the plugin and a geometry, as quoted in
//! ros-event-camera/event_camera_tools and in CenturyArks' readers.

use lobula_core::Geometry;

/// 640x480: Gen3.0 and Gen3.1.
const VGA: Geometry = Geometry::new(640, 480);
/// 1280x720: Gen4.0, Gen4.1 and IMX636.
const HD: Geometry = Geometry::new(1280, 720);

/// Sizes by `system_ID`. A system behind a proxy (onboard) is the same number plus 0x80.
const SYSTEMS: &[(u64, Geometry)] = &[
    (0x15, VGA), // openeb: CCAM3_GEN3
    (0x1C, VGA), // openeb: CCAM3_GEN31
    (0x1A, HD),  // openeb: CCAM3_GEN4
    (0x17, VGA), // openeb: CCAM4_GEN3
    (0x97, VGA), // openeb: CCAM4_GEN3_EVK
    (0x19, VGA), // openeb: CCAM4_GEN3_REV_B
    (0x99, VGA), // openeb: CCAM4_GEN3_REV_B_EVK
    (0x1D, VGA), // openeb: CCAM4_GEN3_REV_B_EVK_BRIDGE
    (0x23, VGA), // openeb: CCAM5_GEN31, also EVK3_GEN31_EVT2
    (0x1E, HD),  // openeb: CCAM5_GEN4
    (0x2E, HD),  // openeb: CCAM5_GEN4_FIXED_FRAME
    (0x21, VGA), // openeb: VISIONCAM_GEN3
    (0xA1, VGA), // openeb: VISIONCAM_GEN3_EVK
    (0x22, VGA), // openeb: VISIONCAM_GEN31
    (0xA2, VGA), // openeb: VISIONCAM_GEN31_EVK
    (0x29, VGA), // openeb: EVK2_GEN31
    (0x1F, HD),  // openeb: EVK2_GEN4
    (0x27, HD),  // openeb: EVK2_GEN41
    (0x28, VGA), // openeb: EVK3_GEN31_EVT3
    (0x30, HD),  // openeb: EVK3_GEN41
    (0x32, HD),  // openeb: EVK2_IMX636
    (0x31, HD),  // openeb: EVK3_IMX636
];

/// Sizes by `plugin_name`.
const PLUGINS: &[(&str, Geometry)] = &[
    ("hal_plugin_gen3_fx3", VGA),   // openeb
    ("hal_plugin_gen31_fx3", VGA),  // openeb
    ("hal_plugin_gen31_evk2", VGA), // openeb
    ("hal_plugin_gen31_evk3", VGA), // openeb
    ("hal_plugin_gen4_fx3", HD),    // openeb
    ("hal_plugin_gen4_evk2", HD),   // openeb
    ("hal_plugin_gen41_evk2", HD),  // openeb
    ("hal_plugin_gen41_evk3", HD),  // openeb
    ("hal_plugin_imx636_evk4", HD), // headers
    ("evc3a_plugin_gen31", VGA),    // headers (CenturyArks SilkyEvCam VGA)
];

/// `system_ID` of the first board (EVK2_SAPHIR) that sends EVT2.1 words in plain little-endian order; openeb reads
/// those of older boards, where the header does not say, with the halves swapped.
const SYSTEM_LITTLE_ENDIAN_FIRST: u64 = 0x37;

/// Size of the sensor in the system of this number.
pub(super) fn geometry_of_system(id: u64) -> Option<Geometry> {
    SYSTEMS.iter().find(|(known, _)| *known == id).map(|(_, geometry)| *geometry)
}

/// Size of the sensor that this plugin drives.
pub(super) fn geometry_of_plugin(name: &str) -> Option<Geometry> {
    PLUGINS.iter().find(|(known, _)| *known == name).map(|(_, geometry)| *geometry)
}

/// Whether the system of this number sends EVT2.1 words with the halves swapped.
pub(super) fn swaps_halves(id: u64) -> bool {
    (1..SYSTEM_LITTLE_ENDIAN_FIRST).contains(&id)
}
