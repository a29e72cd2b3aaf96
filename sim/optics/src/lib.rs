//! From what presses into a camera-based tactile pad to the image its camera sees.
//!
//! The story in order, as the paper tells it ("Details of image formation model"): the shape above the pad and the normal force
//! give an [`indentation`]; the [`elastomer`] rounds it off where the gel leaves the object; near-field [`lamps`] shine on
//! the gel's coating, whose [`reflectance`] sends the light to the [`camera`], which turns it into grey levels. A [`sensor`] is all
//! of that for one camera unit, and a [`model`] all its numbers: nominal, of one unit, or found by a calibration.
//!
//! An image is `background + (model(deformed gel) - model(flat gel))`, and the background itself where the gel is flat.
//!
//! # Frames
//! Everything is in the pad's frame, metres: z out of the surface, camera and lamps at negative z. Maps are row-major, 240 x 240; row 0
//! is the distal edge (largest y), column 0 the smallest x.
//!
//! # Example
//! A ball of 20 mm diameter, pressed with 2 N onto the middle of the index finger's distal pad:
//! ```
//! use hand_model::Hand;
//! use optics::{Sensor, press};
//! use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
//!
//! let hand = Hand::ftac();
//! let pad = hand.pads.iter().find(|pad| pad.name == "index_distal").ok_or("no such pad")?;
//! let camera = &hand.cameras[pad.cameras[0]];
//!
//! let radius = 0.010_f64;
//! let ball = |x: f64, y: f64| {
//!     let inside = radius * radius - x * x - y * y;
//!     (inside > 0.0).then(|| radius - inside.sqrt()) // lowest point of the ball; it touches the surface at z = 0
//! };
//! let pressed = press(pad, &[camera], &hand.parameters.gel, 2.0, ball)?;
//! assert!((pressed.force - 2.0).abs() < 0.01);
//!
//! let sensor = Sensor::unit(pad, camera, 7);
//! let image = sensor.render(&pressed.maps[0], &mut ChaCha8Rng::seed_from_u64(1));
//! assert_ne!(image, **sensor.background());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod calibration;
pub mod camera;
pub mod elastomer;
pub mod error;
pub mod foundation;
pub mod indentation;
pub mod lamps;
pub mod model;
mod noise;
pub mod reflectance;
pub mod sensor;
mod shading;
pub mod shadows;

pub use error::OpticsError;
pub use foundation::Foundation;
pub use indentation::{IndentationMap, Press, press};
pub use model::SensorModel;
pub use sensor::Sensor;
