//! From what presses into a camera-based tactile pad to the image its camera sees.
//!
//! The story in order, as the paper tells it ("Details of image formation model"): the shape above the pad and the normal force
//! give an [`indentation`]; the [`elastomer`] rounds it off where the gel leaves the object; near-field [`lamps`] shine on
//! the gel's coating, each with its cast [`shadows`], whose [`reflectance`] sends the light to the [`camera`], which turns it into grey levels. A [`sensor`] is all
//! of that for one camera unit, and a [`model`] all its numbers: nominal, of one unit, or found by a calibration.
//!
//! Where the gel is deformed or a lamp's light is cut off ([`shadows`]), a pixel's radiance is that of the background's pixel plus
//! `model(deformed gel) - model(flat gel)`; elsewhere the pixel is the background's. How much force an indentation takes is the
//! [`foundation`]'s part, and [`shapes`] has twenty things to press.
//!
//! All of the hand's pads are flat; other sensors' pads may be part of a cylinder ([`cover`], [`CurvedSensor`]).
//!
//! The hand's 17 pads ship with a calibration file each ([`pads`]); many images at once are a [`renderer`]'s part, on the CPU or a GPU.
//!
//! [`calibration`] finds a real sensor's model from presses of a ball, and renders for that sensor at its own image size.
//!
//! What is left out: light from one part of the gel to another; the sideways shift of points pressed towards the camera
//! in a pad's images (the calibrated sensor's renderer has it); distortion in the pads' images, which are rectified (a calibrated sensor
//! may have a [`lens`](calibration::lens)); and pads' rounded edges count as rest shape in the background alone, not in the relief that casts shadows.
//!
//! # Frames
//! Everything is in the pad's frame, metres: z out of the surface, camera and lamps at negative z. Maps are row-major, 240 x 240; row 0
//! is the distal edge (largest y), column 0 the smallest x.
//!
//! # For the owner of a GelSight Mini
//! Take a picture of the untouched gel (`background.png`) and a dozen or two of a steel ball pressed in here and there, all
//! in one folder. If you know where the balls are, say so in `labels.csv` (see [`calibration::folder`]); otherwise they are found.
//! Pictures of a checkerboard tell the lens, pictures under each lamp alone the lamps; both are optional. Then
//! ```sh
//! ftac optics calibrate FOLDER --ball-diameter-mm 6.31 --pixel-mm 0.0634 --out mini.toml
//! ```
//! fits the model to every second press and renders the others; it prints how alike rendered and real images are, beside
//! what the background alone reaches (`floor`) and what the noise allows (`ceiling`). From then on the sensor renders anything.
//! The same by code (here the folder is made first, with a sensor that is known):
//! ```
//! use optics::calibration::{Assumptions, BallFit, CalibratedSensor, CalibrationFile, Effort, PressFolder};
//!
//! # let folder = std::env::temp_dir().join(format!("optics-example-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder)?;
//! # let hand = hand_model::Hand::ftac();
//! # let camera = &hand.cameras[hand.pads[0].cameras[0]];
//! # let (columns, rows) = (96, 72);
//! # let model = optics::SensorModel { noise: 0.0, ..optics::SensorModel::nominal(&hand.pads[0], camera) };
//! # let grey = |at: usize| {
//! #     let (x, y) = ((at % columns) as f64 - 47.5, 35.5 - (at / columns) as f64);
//! #     model.grey(&nalgebra::Point3::new(0.2e-3 * x, 0.2e-3 * y, 0.0), [0.0; 2]).map(|grey| grey as f32)
//! # };
//! # let background: Vec<f32> = (0..columns * rows).flat_map(grey).collect();
//! # let file = CalibrationFile {
//! #     version: 1, columns, rows, pixel_mm: 0.2, contact_over_visible: 1.0, background: String::new(), lens: None, model,
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
//! // Balls of 6.31 mm. For a Mini: `let pixel = 0.0634e-3;` (metres) and `let effort = Effort::default();`.
//! let (fitted, held_out) = PressFolder::read(&folder, 6.31e-3, false)?.even_odd();
//! let fit = BallFit::new(&fitted, Assumptions::full(Some(pixel)), &effort, 1)?;
//! let quality = fit.evaluate(&held_out).ok_or("nothing was held out")?;
//! assert!(quality.rendered.crop.psnr > quality.floor.crop.psnr + 6.0);
//! CalibrationFile::write(&fit, &folder.join("mini.toml"))?;
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
pub mod reflectance;
pub mod renderer;
pub mod sensor;
mod shading;
pub mod shadows;
pub mod shapes;
mod wide;

pub use cover::Cover;
pub use error::OpticsError;
pub use foundation::Foundation;
#[cfg(feature = "gpu")]
pub use gpu::GpuRenderer;
pub use indentation::{IndentationMap, Press, press};
pub use model::{SensorModel, Variation};
pub use renderer::{CpuRenderer, Job, Renderer};
pub use sensor::{CurvedSensor, Sensor};
