//! Optical parameters of the hand's 17 pads of six configurations, one file each.
//!
//! A file (`data/pads/<pad>.toml`) contains the design model of each of a pad's cameras and the variation between
//! units. The simulator renders with these files, and a hand's serial number determines its units. `ftac optics pads
//! --out DIR` regenerates the files, or writes those of one unit. A pad without a file (of another hand) gets
//! [`SensorModel::nominal`].

use std::fmt::Write as _;
use std::sync::OnceLock;

use hand_model::Hand;
use hand_model::pads::{Pad, PadCamera};
use serde::{Deserialize, Serialize};

use crate::error::OpticsError;
use crate::model::{SensorModel, UnitVariation};
use crate::versioned;

/// Version of the file format.
pub const VERSION: u32 = 1;

/// The model of one camera of a pad.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraOptics {
    /// Name of the camera in the hand.
    pub name: String,
    /// The camera's model, pad frame.
    pub model: SensorModel,
}

/// Content of a pad's file: design models of its cameras and the variation between units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PadOptics {
    /// Version of the file format.
    pub version: u32,
    /// Name of the pad.
    pub pad: String,
    /// Sensor configuration, `a` to `f`.
    pub configuration: char,
    /// Size across the digit, mm.
    pub width_mm: f64,
    /// Size along the digit, mm.
    pub height_mm: f64,
    /// Variation of units around the models below.
    pub variation: UnitVariation,
    /// Models of the cameras, in the order of the pad's cameras.
    pub camera: Vec<CameraOptics>,
}

const FILE_COMMENT: &str = "\
# Frame: the pad's, origin in the middle of its surface, x across, y along the digit, z out of the gel; lamps and camera at negative z.
# Lengths in metres unless the name says mm.
# [variation]: standard deviations from unit to unit; lamp_turn in rad, texture in grey levels, those without a unit relative.
# A grey level M (0 to 1) stands for the radiance G(M) = g1 M + g2 M^2 + g3 M^3 (`coefficients`), after the channel's `gain`.
# A lamp gives a place at distance |s| the light eta color (cos of the angle to its direction)^mu / |s|^2; `size` is half its extent.
# `albedo` is rho of each channel, `roughness` that of Oren and Nayar (rad); `ambient` is diffuse light; `noise` the read-out's, grey levels.
# `kernels` (standard deviations) smooth the gel around a contact; an object is grown by `coating`.
";

impl PadOptics {
    /// Returns the design of a pad.
    pub fn nominal(hand: &Hand, pad: &Pad) -> Self {
        let camera = |&index: &usize| {
            let camera = &hand.cameras[index];
            CameraOptics { name: camera.name.clone(), model: SensorModel::nominal(pad, camera) }
        };
        Self {
            version: VERSION,
            pad: pad.name.clone(),
            configuration: pad.configuration,
            width_mm: 1e3 * pad.w,
            height_mm: 1e3 * pad.h,
            variation: UnitVariation::default(),
            camera: pad.cameras.iter().map(camera).collect(),
        }
    }

    /// Samples one unit of the series, without further variation; its cameras' serial numbers start at `serial`.
    pub fn unit(&self, serial: u64) -> Self {
        let mut unit = self.clone();
        for (camera, serial) in unit.camera.iter_mut().zip(serial..) {
            camera.model = camera.model.varied(&self.variation, serial);
        }
        let none =
            UnitVariation { lamp_place: 0.0, lamp_turn: 0.0, lamp_strength: 0.0, lamp_pattern: 0.0, ..self.variation };
        unit.variation = UnitVariation { camera_place: 0.0, albedo: 0.0, gain: 0.0, roughness: 0.0, ..none };
        unit
    }

    /// Writes the text of the file, with comments.
    pub fn to_toml(&self) -> Result<String, OpticsError> {
        let body = toml::to_string(self).map_err(OpticsError::calibration)?;
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "# Optics of pad `{}`, configuration {}; see sim/optics/src/pads.rs.",
            self.pad, self.configuration
        );
        Ok(text + FILE_COMMENT + "\n" + &body)
    }

    /// Reads and checks the text of a file.
    pub fn parse(text: &str) -> Result<Self, OpticsError> {
        let found: Self = versioned::parse(text, VERSION)?;
        for camera in &found.camera {
            let named = |error| OpticsError::calibration(format!("camera `{}`: {error}", camera.name));
            camera.model.check().map_err(named)?;
        }
        Ok(found)
    }

    /// Returns the models of a pad's cameras, in order. Returns an error for another pad.
    pub fn models(&self, hand: &Hand, pad: &Pad) -> Result<Vec<SensorModel>, OpticsError> {
        if !self.fits(pad) {
            return Err(OpticsError::Calibration(format!(
                "found pad `{}` of {:.1} x {:.1} mm; expected `{}` of {:.1} x {:.1} mm",
                self.pad,
                self.height_mm,
                self.width_mm,
                pad.name,
                1e3 * pad.h,
                1e3 * pad.w
            )));
        }
        let model = |&index: &usize| {
            let name = &hand.cameras[index].name;
            let known = self.camera.iter().find(|camera| camera.name == *name);
            let missing = || OpticsError::Calibration(format!("found no camera `{name}`; expected one"));
            known.map(|camera| camera.model.clone()).ok_or_else(missing)
        };
        pad.cameras.iter().map(model).collect()
    }

    fn fits(&self, pad: &Pad) -> bool {
        let same = |mm: f64, m: f64| (mm - 1e3 * m).abs() < 1e-6;
        self.pad == pad.name && same(self.width_mm, pad.w) && same(self.height_mm, pad.h)
    }
}

// The shipped files.
const SHIPPED_FILES: [&str; 17] = [
    include_str!("../data/pads/index_distal.toml"),
    include_str!("../data/pads/index_middle.toml"),
    include_str!("../data/pads/index_proximal.toml"),
    include_str!("../data/pads/little_distal.toml"),
    include_str!("../data/pads/little_middle.toml"),
    include_str!("../data/pads/little_proximal.toml"),
    include_str!("../data/pads/middle_distal.toml"),
    include_str!("../data/pads/middle_middle.toml"),
    include_str!("../data/pads/middle_proximal.toml"),
    include_str!("../data/pads/palm_radial.toml"),
    include_str!("../data/pads/palm_ulnar.toml"),
    include_str!("../data/pads/ring_distal.toml"),
    include_str!("../data/pads/ring_middle.toml"),
    include_str!("../data/pads/ring_proximal.toml"),
    include_str!("../data/pads/thumb_distal.toml"),
    include_str!("../data/pads/thumb_metacarpal.toml"),
    include_str!("../data/pads/thumb_proximal.toml"),
];

/// Returns the shipped designs. Invalid files are skipped; a test checks that there are none.
pub fn shipped_designs() -> &'static [PadOptics] {
    static DESIGNS: OnceLock<Vec<PadOptics>> = OnceLock::new();
    DESIGNS.get_or_init(|| SHIPPED_FILES.iter().flat_map(|text| PadOptics::parse(text)).collect())
}

/// Returns the design model and variation of a camera: from the pad's file, or nominal for a pad without one.
pub fn design(pad: &Pad, camera: &PadCamera) -> (SensorModel, UnitVariation) {
    let known = shipped_designs().iter().find(|calibration| calibration.fits(pad));
    let model =
        known.and_then(|known| known.camera.iter().find(|other| other.name == camera.name).map(|own| (own, known)));
    match model {
        Some((own, known)) => (own.model.clone(), known.variation),
        None => (SensorModel::nominal(pad, camera), UnitVariation::default()),
    }
}

impl SensorModel {
    /// Samples one unit of a series: the shipped design ([`design`]) with the variation shipped with it; `seed` is the
    /// unit's serial number.
    pub fn unit(pad: &Pad, camera: &PadCamera, seed: u64) -> Self {
        let (design, variation) = design(pad, camera);
        design.varied(&variation, seed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_files_are_the_design() {
        let hand = Hand::ftac();
        assert_eq!(shipped_designs().len(), hand.pads.len());
        for pad in &hand.pads {
            let found = shipped_designs().iter().find(|calibration| calibration.pad == pad.name).unwrap();
            assert_eq!(*found, PadOptics::nominal(&hand, pad), "run `ftac optics pads --out sim/optics/data/pads`");
            assert_eq!(found.models(&hand, pad).unwrap().len(), pad.cameras.len());
        }
    }

    #[test]
    fn bad_files_are_refused_by_field() {
        let hand = Hand::ftac();
        let good = PadOptics::nominal(&hand, &hand.pads[0]);
        let text = good.to_toml().unwrap();
        assert_eq!(PadOptics::parse(&text).unwrap(), good);
        let refusal = |text: String, parts: &[&str]| {
            let error = PadOptics::parse(&text).unwrap_err().to_string();
            assert!(parts.iter().all(|part| error.contains(part)), "{error}");
        };
        refusal(text.replace("version = 1", "version = 2"), &["version", "found 2", "expected 1"]);
        refusal(text.replace("version = 1\n", ""), &["version", "found none"]);
        refusal(text.replace("roughness = 0.2", "roughness = -0.2"), &[&good.camera[0].name, "roughness", "-0.2"]);
        refusal(text.replace("lamp_turn", "lamp_burn"), &["lamp_burn"]);
        let error = good.models(&hand, &hand.pads[16]).unwrap_err().to_string();
        assert!(error.contains(&good.pad) && error.contains(&hand.pads[16].name), "{error}");
    }

    #[test]
    fn a_unit_varies_once() {
        let hand = Hand::ftac();
        let design = PadOptics::nominal(&hand, &hand.pads[2]);
        let unit = design.unit(7);
        assert_ne!(unit.camera, design.camera);
        assert_eq!(unit.camera[0].model, SensorModel::unit(&hand.pads[2], &hand.cameras[hand.pads[2].cameras[0]], 7));
        let again = unit.unit(8);
        let (a, b) = (&unit.camera[0].model, &again.camera[0].model);
        assert!(a.lamps.iter().zip(&b.lamps).all(|(a, b)| (a.position - b.position).norm() < 1e-12));
    }
}
