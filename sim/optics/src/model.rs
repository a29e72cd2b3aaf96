//! All parameters of one camera unit's image formation, their nominal values, and the variation between units.

use hand_model::pads::{Pad, PadCamera};
use nalgebra::{Point3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use crate::camera::{CameraResponse, Pinhole};
use crate::elastomer::Elastomer;
use crate::error::OpticsError;
use crate::lamps::Lamp;
use crate::reflectance::Reflectance;

/// The image-formation model of one camera unit, pad frame: the result of a calibration.
///
/// ```
/// use nalgebra::Point3;
/// use tactile_optics::hand_model::Hand;
/// use tactile_optics::{SensorModel, UnitVariation};
///
/// let hand = Hand::ftac();
/// let camera = &hand.cameras[0];
/// let design = SensorModel::nominal(&hand.pads[camera.pad], camera);
/// let unit = design.varied(&UnitVariation::default(), 7);
/// assert_ne!(unit, design);
/// assert_eq!(SensorModel::from_toml(&unit.to_toml()?)?, unit);
///
/// // Red lamps are at +x: gel that faces them is redder.
/// let [level, facing] = [0.0, 0.3].map(|slope| design.grey(&Point3::origin(), [slope, 0.0]));
/// assert!(facing[0] > level[0] && facing[1] < level[1]);
/// # Ok::<(), tactile_optics::OpticsError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SensorModel {
    /// White-balance gain of each channel, from radiance (model units, 1/m2) to the response's 0..1.
    pub gain: [f64; 3],
    /// Standard deviation of the read-out noise, grey levels of 255.
    pub noise: f64,
    /// Standard deviations of the background's blotches and grain, grey levels.
    pub texture: [f64; 2],
    /// Diffuse light on a level surface from all directions behind the gel: red, green, blue, in units of full scale.
    #[serde(default)]
    pub ambient: [f64; 3],
    /// The camera behind the gel.
    pub camera: Pinhole,
    /// Reflectance of the gel's coating.
    pub reflectance: Reflectance,
    /// Response of the red, green and blue channel.
    pub response: [CameraResponse; 3],
    /// Smoothing of the gel around a contact.
    pub elastomer: Elastomer,
    /// Lamps behind the gel.
    pub lamps: Vec<Lamp>,
}

/// Variation between units: standard deviations, relative where no unit is given.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitVariation {
    /// Lamp positions, each axis, m.
    pub lamp_place: f64,
    /// Lamp directions, each axis, rad.
    pub lamp_turn: f64,
    /// The lamps' strength eta.
    pub lamp_strength: f64,
    /// Exponents of the lamps' radiation patterns.
    pub lamp_pattern: f64,
    /// Camera position, each axis, m.
    pub camera_place: f64,
    /// The coating's albedo, each channel.
    pub albedo: f64,
    /// Gains, each channel.
    pub gain: f64,
    /// The coating's roughness.
    pub roughness: f64,
    /// Blotches and grain of a unit's background, grey levels.
    pub texture: [f64; 2],
}

impl Default for UnitVariation {
    /// Returns values typical of hand-assembled units: lamps within 0.2 mm and 3 degrees, and 5 % of their strength.
    fn default() -> Self {
        Self {
            lamp_place: 0.2e-3,
            lamp_turn: 0.05,
            lamp_strength: 0.05,
            lamp_pattern: 0.02,
            camera_place: 0.2e-3,
            albedo: 0.02,
            gain: 0.02,
            roughness: 0.05,
            texture: [2.0, 0.8],
        }
    }
}

/// Mean grey level of an untouched nominal sensor's flat gel, each channel.
pub const NOMINAL_GREY: f64 = 115.0;

/// Smallest distance (m) of a lamp from the gel, in a file and in a fit.
pub(crate) const MIN_LAMP_DISTANCE: f64 = 1e-3;

/// Largest width of a kernel and thickness of a coating, m.
const MAX_THICKNESS: f64 = 0.02;

/// Distance (m) of the lamps outside the camera's rectangle, inside the housing.
const LAMP_RIM_DISTANCE: f64 = 0.0015;

impl SensorModel {
    /// Returns the design: red lamps along +x, green along -x, blue at +y, yellow at -y, and two white ones beside the
    /// camera.
    ///
    /// Red minus green gives the slope across, blue against both the slope along, and no slope is dark in all channels.
    /// The lamps have lenses and are aimed beyond the centre, so that their light varies little over the pad. A pad with
    /// two cameras has one such ring per camera.
    pub fn nominal(_pad: &Pad, camera: &PadCamera) -> Self {
        Self::nominal_of(camera)
    }

    /// Like [`Self::nominal`]: the design depends on the camera's rectangle alone.
    pub(crate) fn nominal_of(camera: &PadCamera) -> Self {
        let (half_w, half_h, middle) = (0.5 * camera.w, 0.5 * camera.h, camera.center_y);
        let depth = (0.3 * camera.w.max(camera.h)).clamp(0.010, 0.016);
        let at = |x: f64, y: f64, z: f64| Point3::new(x, middle + y, z);
        let mut lamps = Vec::new();
        // Positions of the lamps along a side, at most 25 mm apart.
        let along = |length: f64| {
            let count = (length / 0.025).ceil().max(1.0);
            (0..count as usize).map(move |i| (((i as f64 + 0.5) / count - 0.5) * length, 1.0 / count))
        };
        for (sign, color) in [(1.0, [1.0, 0.05, 0.05]), (-1.0, [0.05, 1.0, 0.05])] {
            for (y, share) in along(camera.h) {
                let position = at(sign * (half_w + LAMP_RIM_DISTANCE), y, -depth);
                lamps.push(Lamp::aimed(position, at(-sign * 0.55 * half_w, y, 0.0), share, 1.5, color));
            }
        }
        let reach = 0.55 * camera.h / camera.w;
        for (sign, color) in [(1.0, [0.05, 0.05, 1.0]), (-1.0, [0.8, 0.8, 0.05])] {
            for (x, share) in along(camera.w) {
                let position = at(x, sign * (half_h + LAMP_RIM_DISTANCE), -depth);
                lamps.push(Lamp::aimed(position, at(x, -sign * 0.9 * half_h, 0.0), reach * share, 2.5, color));
            }
        }
        for sign in [-1.0, 1.0] {
            let position = at(0.0, sign * 0.55 * half_h, -depth - 0.004);
            lamps.push(Lamp::aimed(position, at(0.0, sign * 0.6 * half_h, 0.0), 0.15, 1.0, [1.0; 3]));
        }
        let compressive = CameraResponse { coefficients: [0.75, 0.15, 0.10] };
        let mut model = Self {
            gain: [1.0; 3],
            noise: 0.7,
            texture: [0.0; 2],
            ambient: [0.0; 3],
            camera: Pinhole { position: at(0.0, 0.0, -depth - 0.004) },
            reflectance: Reflectance { albedo: [0.9; 3], roughness: 0.2 },
            response: [compressive; 3],
            elastomer: Elastomer::default(),
            lamps,
        };
        model.balance_gains(camera);
        model
    }

    /// Samples the model of one unit of a series; `seed` is its serial number.
    pub fn varied(&self, by: &UnitVariation, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut vary = |deviation: f64| deviation * rng.sample::<f64, _>(StandardNormal);
        let mut model = self.clone();
        for lamp in &mut model.lamps {
            lamp.position += Vector3::new(vary(by.lamp_place), vary(by.lamp_place), vary(by.lamp_place));
            let turn = Vector3::new(vary(by.lamp_turn), vary(by.lamp_turn), vary(by.lamp_turn));
            lamp.direction = (lamp.direction + turn).normalize();
            lamp.eta *= vary(by.lamp_strength).exp();
            lamp.mu = (lamp.mu * vary(by.lamp_pattern).exp()).max(0.0);
        }
        model.camera.position += Vector3::new(vary(by.camera_place), vary(by.camera_place), vary(by.camera_place));
        for channel in 0..3 {
            model.reflectance.albedo[channel] *= vary(by.albedo).exp();
            model.gain[channel] *= vary(by.gain).exp();
        }
        model.reflectance.roughness *= vary(by.roughness).exp();
        model.texture = by.texture;
        model
    }

    /// Computes the radiance of a surface point with slopes dz/dx, dz/dy under all lamps, after the gain: the reference
    /// implementation, in double precision.
    pub fn radiance(&self, point: &Point3<f64>, slope: [f64; 2]) -> [f64; 3] {
        self.radiance_with_shadows(point, slope, |_| 1.0)
    }

    /// Like [`Self::radiance`], with the visible share of each lamp.
    pub fn radiance_with_shadows(
        &self,
        point: &Point3<f64>,
        slope: [f64; 2],
        share: impl Fn(usize) -> f64,
    ) -> [f64; 3] {
        let normal = Vector3::new(slope[0], slope[1], -1.0).normalize();
        let viewer = self.camera.direction_to_camera(point);
        // A tilted surface receives diffuse light from a smaller part of the half space.
        let mut sum = self.ambient.map(|ambient| ambient * 0.5 * (1.0 - normal.z));
        for (k, lamp) in self.lamps.iter().enumerate() {
            let (s, kappa) = lamp.direction_and_irradiance(point);
            let kappa = share(k) * kappa;
            let radiance = self.reflectance.radiance(kappa, &normal, &s, &viewer);
            for c in 0..3 {
                sum[c] += self.gain[c] * lamp.color[c] * radiance[c];
            }
        }
        sum
    }

    /// Computes the grey levels of a surface point, which may exceed 255.
    pub fn grey(&self, point: &Point3<f64>, slope: [f64; 2]) -> [f64; 3] {
        let radiance = self.radiance(point, slope);
        std::array::from_fn(|c| 255.0 * self.response[c].measured(radiance[c]))
    }

    /// Sets the gains so that the flat gel's mean grey level is [`NOMINAL_GREY`] in each channel.
    fn balance_gains(&mut self, camera: &PadCamera) {
        const SAMPLES_PER_SIDE: usize = 12;
        let mut sum = [0.0; 3];
        for i in 0..SAMPLES_PER_SIDE * SAMPLES_PER_SIDE {
            let place = |k: usize| (k as f64 + 0.5) / SAMPLES_PER_SIDE as f64 - 0.5;
            let point = Point3::new(
                place(i % SAMPLES_PER_SIDE) * camera.w,
                camera.center_y + place(i / SAMPLES_PER_SIDE) * camera.h,
                0.0,
            );
            let radiance = self.radiance(&point, [0.0; 2]);
            (0..3).for_each(|c| sum[c] += radiance[c]);
        }
        for ((gain, sum), response) in self.gain.iter_mut().zip(sum).zip(&self.response) {
            let mean = sum / (SAMPLES_PER_SIDE * SAMPLES_PER_SIDE) as f64;
            *gain *= response.radiance(NOMINAL_GREY / 255.0) / mean;
        }
    }

    /// Serialises the model; [`Self::from_toml`] reads it back.
    pub fn to_toml(&self) -> Result<String, OpticsError> {
        toml::to_string(self).map_err(OpticsError::calibration)
    }

    /// Parses and checks a model.
    pub fn from_toml(text: &str) -> Result<Self, OpticsError> {
        let model: Self = toml::from_str(text).map_err(OpticsError::calibration)?;
        model.check()?;
        Ok(model)
    }

    /// Checks for impossible values; the error names the field.
    pub fn check(&self) -> Result<(), OpticsError> {
        let fault = |what: String| Err(OpticsError::Calibration(what));
        let lamps = self.lamps.iter().flat_map(|lamp| {
            let Lamp { position, direction, eta, mu, color, size } = lamp;
            position.iter().chain(direction.iter()).chain([eta, mu, size]).chain(color).copied().collect::<Vec<f64>>()
        });
        let numbers =
            [("gain", &self.gain[..]), ("ambient", &self.ambient), ("reflectance.albedo", &self.reflectance.albedo)];
        for (name, values) in numbers {
            if let Some(value) = values.iter().find(|value| !(**value >= 0.0 && value.is_finite())) {
                return fault(format!("{name} has {value}; expected finite numbers of at least 0"));
            }
        }
        if let Some(value) = lamps.chain(self.camera.position.iter().copied()).find(|value| !value.is_finite()) {
            return fault(format!("a lamp or the camera has {value}; expected finite numbers"));
        }
        if let Some(value) =
            self.response.iter().flat_map(|response| response.coefficients).find(|value| !value.is_finite())
        {
            return fault(format!("response has {value}; expected finite numbers"));
        }
        let Elastomer { kernels, coating } = &self.elastomer;
        if let Some(value) = kernels.iter().chain([coating]).find(|value| !(0.0..=MAX_THICKNESS).contains(*value)) {
            return fault(format!("elastomer has {value} m; expected 0 to {MAX_THICKNESS} m"));
        }
        for (k, lamp) in self.lamps.iter().enumerate() {
            if !(lamp.direction.norm() - 1.0).abs().le(&1e-3) {
                return fault(format!("lamps[{k}].direction has length {}; expected 1", lamp.direction.norm()));
            }
            if !(lamp.eta >= 0.0 && lamp.mu >= 0.0 && lamp.eta.is_finite() && lamp.mu.is_finite()) {
                return fault(format!("lamps[{k}]: eta {} and mu {} must be finite and at least 0", lamp.eta, lamp.mu));
            }
            if !lamp.position.z.le(&-MIN_LAMP_DISTANCE) {
                return fault(format!(
                    "lamps[{k}].position.z is {} m; expected it behind the gel (at most -{MIN_LAMP_DISTANCE})",
                    lamp.position.z
                ));
            }
        }
        if !self.camera.position.z.lt(&-0.003) {
            return fault(format!(
                "camera.position.z is {} m; expected it behind the gel (below -0.003)",
                self.camera.position.z
            ));
        }
        if !(self.reflectance.roughness >= 0.0 && self.reflectance.roughness.is_finite()) {
            return fault(format!("reflectance.roughness is {}; expected at least 0", self.reflectance.roughness));
        }
        if let Some(c) = self.response.iter().position(|response| !response.is_monotonic()) {
            return fault(format!("response[{c}] does not rise everywhere between 0 and 1"));
        }
        if !(self.noise >= 0.0 && self.texture.iter().all(|deviation| *deviation >= 0.0)) {
            return fault("noise and texture must be at least 0".into());
        }
        Ok(())
    }
}
