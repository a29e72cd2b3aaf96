//! Image formation of a camera-based tactile sensor: from the shape and force that press into a pad to the image its
//! camera sees.
//!
//! The steps follow the paper ("Details of image formation model"). The object's shape above the pad and the normal force
//! give an [`indentation`]. The [`elastomer`] rounds it off where the gel leaves the object. Near-field [`lamps`]
//! illuminate the gel's coating, with cast [`shadows`]; its [`reflectance`] sends light to the [`camera`], which turns
//! radiance into grey levels. A [`sensor`] combines these steps for one camera unit, and a [`model`] holds all its
//! parameters: nominal, of one unit, or calibrated.
//!
//! A pixel on deformed or shadowed gel has the background pixel's radiance plus `model(deformed gel) - model(flat
//! gel)`; any other pixel is the background's. The [`foundation`] relates force to indentation, and [`shapes`] has
//! twenty test objects.
//!
//! All of the hand's pads are flat; a pad of another sensor may be part of a cylinder ([`cover`], [`CurvedSensor`]). The
//! hand's 17 pads ship with one parameter file each ([`pads`]). A [`renderer`] makes many images at once, on the CPU or a
//! GPU. [`calibration`] fits the model of a real sensor to presses of a ball and renders at that sensor's own image size.
//!
//! Not modelled:
//! - light from one part of the gel to another;
//! - the sideways shift of points pressed towards the camera in a pad's images (the calibrated sensor's renderer has
//!   it);
//! - lens distortion in the pads' images, which are rectified (a calibrated sensor may have a
//!   [`lens`](calibration::lens)).
//!
//! The pads' rounded edges shape the background only, not the relief that casts shadows.
//!
//! # Frames
//! Everything is in the pad's frame, in metres: z out of the surface, camera and lamps at negative z. Maps are
//! row-major, 240 x 240; row 0 is the distal edge (largest y), column 0 has the smallest x.
//!
//! # For the owner of a GelSight Mini
//! Put a picture of the untouched gel (`background.png`) and a dozen or two of a steel ball pressed in at different
//! positions into one folder. `labels.csv` may give the balls' positions (see [`calibration::folder`]); otherwise they
//! are detected. Optional pictures of a checkerboard calibrate the lens, and pictures under each lamp alone the lamps.
//! Then
//! ```sh
//! ftac optics calibrate FOLDER --ball-diameter-mm 6.31 --pixel-mm 0.0634 --out mini.toml
//! ```
//! fits the model to every second press and renders the others. It prints the similarity of rendered and real images, with
//! that of the background alone (`floor`) and the best that the noise allows (`ceiling`). The calibrated sensor then renders
//! any object. The same in code (the folder is generated first, from a known sensor):
//! ```
//! use tactile_optics::calibration::{Assumptions, BallFit, CalibratedSensor, SensorCalibration, Effort, PressFolder};
//!
//! # let folder = std::env::temp_dir().join(format!("optics-example-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder)?;
//! # let hand = hand_model::Hand::ftac();
//! # let camera = &hand.cameras[hand.pads[0].cameras[0]];
//! # let (columns, rows) = (96, 72);
//! # let model = tactile_optics::SensorModel { noise: 0.0, ..optics::SensorModel::nominal(&hand.pads[0], camera) };
//! # let grey = |at: usize| {
//! #     let (x, y) = ((at % columns) as f64 - 47.5, 35.5 - (at / columns) as f64);
//! #     model.grey(&nalgebra::Point3::new(0.2e-3 * x, 0.2e-3 * y, 0.0), [0.0; 2]).map(|grey| grey as f32)
//! # };
//! # let background: Vec<f32> = (0..columns * rows).flat_map(grey).collect();
//! # let file = SensorCalibration {
//! #     version: 1, columns, rows, pixel_mm: 0.2, pixel_interval_mm: None, contact_over_visible: 1.0, background: String::new(), lens: None, model,
//! # };
//! # let known = CalibratedSensor::new(file, background)?;
//! # known.render(&vec![f32::NEG_INFINITY; columns * rows])?.write(&folder.join("background.png"))?;
//! # let mut labels = String::from("file,center_x_px,center_y_px,contact_radius_px\n");
//! # for (n, [x, y]) in [[30.0, 25.0], [62.0, 30.0], [40.0, 48.0], [66.0, 50.0]].into_iter().enumerate() {
//! #     known.render(&known.ball([x, y], 9.0, 6.31e-3))?.write(&folder.join(format!("{n}.png")))?;
//! #     labels += &format!("{n}.png,{x},{y},9\n");
//! # }
//! # std::fs::write(folder.join("labels.csv"), labels)?;
//! # let pixel = 0.2e-3;
//! # let effort = Effort { per_press: 120, ..Effort::default() };
//! // Balls of 6.31 mm. For a Mini: `let pixel = 0.0634e-3;` (metres) and `let effort = FitEffort::default();`.
//! let (fitted, held_out) = PressFolder::read(&folder, 6.31e-3, false)?.even_odd();
//! let fit = BallFit::new(&fitted, Assumptions::full(Some(pixel)), &effort, 1)?;
//! let quality = fit.evaluate(&held_out).ok_or("nothing was held out")?;
//! assert!(quality.rendered.crop.psnr > quality.floor.crop.psnr + 6.0);
//! SensorCalibration::write(&fit, &folder.join("mini.toml"))?;
//!
//! // A rod of 2 mm radius along y, pressed in by 0.4 mm: how far it lies below the untouched gel, pixel by pixel.
//! let sensor = CalibratedSensor::read(&folder.join("mini.toml"))?;
//! let (columns, rows) = sensor.size();
//! let penetration: Vec<f32> = (0..columns * rows)
//!     .map(|at| sensor.pixel_center((at % columns) as f64, (at / columns) as f64))
//!     .map(|(x, _)| 0.002_f64.powi(2) - x * x)
//!     .map(|inside| if inside > 0.0 { (inside.sqrt() - 0.002 + 0.0004) as f32 } else { f32::NEG_INFINITY })
//!     .collect();
//! sensor.render(&penetration)?.write(&folder.join("rod.png"))?;
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Example
//! A ball of 20 mm diameter, pressed with 2 N onto the middle of the index finger's distal pad:
//! ```
//! use hand_model::Hand;
//! use tactile_optics::{Sensor, press};
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
pub mod cover;
pub mod elastomer;
pub mod error;
pub mod foundation;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod indentation;
pub mod lamps;
pub mod model;
mod noise;
pub mod pads;
pub mod raster;
pub mod reflectance;
pub mod renderer;
pub mod sensor;
mod shading;
pub mod shadows;
pub mod shapes;
mod versioned;
mod wide;

pub use cover::PadCover;
pub use error::OpticsError;
pub use foundation::GelFoundation;
#[cfg(feature = "gpu")]
pub use gpu::GpuRenderer;
pub use indentation::{IndentationMap, PressResult, press};
pub use model::{SensorModel, UnitVariation};
pub use raster::Raster;
pub use renderer::{CpuRenderer, RenderJob, Renderer};
pub use sensor::Sensor;
pub use sensor::curved::CurvedSensor;
pub use sensor::reduced::ReducedSensor;
