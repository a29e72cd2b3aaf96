//! The simulated camera board: tactile images of everything that presses into the pads.
//!
//! For each pad the objects over it are sampled by rays along the pad's normal, pressed in until the gel bears the
//! normal force that the engine reports for the cover (the engine's penetration is meaningless as a depth), and
//! rendered. With self-contact, links of the hand and the table press as well, each with its own force. With drift,
//! every frame of an idle pad has its own read-out noise and brightness; without it, the frame is the background
//! itself.

mod drift;

use std::io::Write as _;
use std::sync::Arc;

use hand_model::Hand;
use hand_model::pads::{IMAGE_SIZE, PadCamera};
use hand_model::robot::{TactileFrame, TactileImage};
use nalgebra::{Isometry3, Point3, Unit, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tactile_optics::indentation::press_rasters;
use tactile_optics::{
    CpuRenderer, GelFoundation, IndentationMap, OpticsError, Raster, ReducedSensor, RenderJob, Renderer, Sensor,
    SensorModel,
};
use world::geometry::{MeshHeightMap, ObjectShape};

pub use drift::BrightnessDrift;

/// Distance between bounding spheres and a pad's centre beyond which objects are ignored, m.
const OBJECT_REACH: f64 = 0.005;
/// Force threshold below which a pad is idle, N.
const MIN_FORCE: f64 = 0.02;
/// Factor on the radius of a shape's bounding sphere beyond which a ray surely misses the shape.
const BOUNDING_RADIUS_FACTOR: f64 = 1.001;
/// Substitute for the capture time in the noise seed of a background frame; no real capture time comes near it.
const BACKGROUND_MOMENT: u64 = 0x00ba_c4c4;
/// Start depth of rays under the pad's surface, m: deeper than any contact, inside the phalanx.
const RAY_START: f64 = 0.006;

/// Computes the serial number of camera `n` of hand unit `serial`.
pub fn unit_seed(serial: u64, n: usize) -> u64 {
    serial.wrapping_mul(1000).wrapping_add(n as u64)
}

/// The 18 cameras of one hand unit; in an empty board the cameras are off.
#[derive(Clone)]
pub struct TactileBoard {
    renderer: Arc<dyn Renderer>,
    noise_seed: u64,
    drift: Option<Arc<BrightnessDrift>>,
    /// The sensors at a smaller image size, if frames have that size.
    reduced: Option<Arc<Vec<ReducedSensor>>>,
    sequence: u64,
}

/// Load of a link of the hand or of the table on a pad.
#[derive(Debug, Clone)]
pub struct SelfLoad {
    /// Index of the pad.
    pub pad: usize,
    /// Normal force, N.
    pub force: f64,
    /// Shape of the part that presses.
    pub shape: ObjectShape,
    /// `world_from_shape`.
    pub pose: Isometry3<f64>,
}

/// All loads on the pads at one moment.
#[derive(Debug, Clone, Copy)]
pub struct PadLoads<'a> {
    /// `world_from_pad`.
    pub pads: &'a [Isometry3<f64>],
    /// Normal force of all objects on each pad, N.
    pub forces: &'a [f64],
    /// Objects that may exert these forces, with `world_from_object`.
    pub objects: &'a [(&'a ObjectShape, Isometry3<f64>)],
    /// Loads of the hand and of the table on the hand's own pads.
    pub self_loads: &'a [SelfLoad],
}

impl TactileBoard {
    /// Creates a board whose cameras are off.
    pub fn blank() -> Self {
        Self::with_renderer(Arc::new(CpuRenderer::new(Arc::new(Vec::new()))))
    }

    /// Creates a board from the sensors of any renderer, one per camera.
    pub fn with_renderer(renderer: Arc<dyn Renderer>) -> Self {
        Self { renderer, noise_seed: 0, drift: None, reduced: None, sequence: 0 }
    }

    /// Creates the 18 cameras of hand unit number `serial`; the cameras differ slightly from each other.
    pub fn unit(hand: &Hand, serial: u64) -> Self {
        let sensors: Vec<Sensor> = hand
            .cameras
            .par_iter()
            .enumerate()
            .map(|(n, camera)| Sensor::unit(&hand.pads[camera.pad], camera, unit_seed(serial, n)))
            .collect();
        Self::with_renderer(Arc::new(CpuRenderer::new(Arc::new(sensors))))
    }

    /// Creates hand unit `serial` with a changed model of each camera (by index).
    pub fn with_models(
        hand: &Hand,
        serial: u64,
        change: impl Fn(usize, &mut SensorModel),
    ) -> Result<Self, OpticsError> {
        let sensor = |(n, camera): (usize, &PadCamera)| {
            let (pad, seed) = (&hand.pads[camera.pad], unit_seed(serial, n));
            let mut model = SensorModel::unit(pad, camera, seed);
            change(n, &mut model);
            Sensor::with_model(pad, camera, model, seed)
        };
        let sensors: Result<Vec<_>, _> = hand.cameras.iter().enumerate().map(sensor).collect();
        Ok(Self::with_renderer(Arc::new(CpuRenderer::new(Arc::new(sensors?)))))
    }

    /// Returns the same board with another stream of read-out noise.
    pub fn with_noise(&self, seed: u64) -> Self {
        Self { noise_seed: seed, sequence: 0, ..self.clone() }
    }

    /// Returns the same board with drifting cameras; its frames of idle pads have noise.
    pub fn drifting(self, drift: BrightnessDrift) -> Self {
        Self { drift: Some(Arc::new(drift)), ..self }
    }

    /// Returns the same board with frames of `side` x `side` pixels, rendered by the CPU. It is meant for learning from
    /// many images, not for perception, which uses the full size.
    pub fn reduced(self, side: usize) -> Result<Self, OpticsError> {
        let reduced: Result<Vec<_>, _> =
            self.sensors().par_iter().map(|sensor| ReducedSensor::new(sensor, side)).collect();
        Ok(Self { reduced: Some(Arc::new(reduced?)), ..self })
    }

    /// Returns the images of the untouched pads, one per camera.
    pub fn backgrounds(&self) -> Vec<Arc<TactileImage>> {
        (0..self.sensors().len()).map(|camera| self.background(camera)).collect()
    }

    fn background(&self, camera: usize) -> Arc<TactileImage> {
        match &self.reduced {
            Some(reduced) => reduced[camera].background().clone(),
            None => self.sensors()[camera].background().clone(),
        }
    }

    /// Renders one frame of each camera of the untouched pads, from before time zero: with noise if the board drifts,
    /// else the backgrounds themselves.
    pub fn background_frames(&self) -> Vec<Arc<TactileImage>> {
        if self.drift.is_none() {
            return self.backgrounds();
        }
        let idle = IndentationMap::idle();
        let job = |sensor: usize| RenderJob {
            sensor,
            indentation: &idle,
            noise_seed: self.frame_noise_seed(BACKGROUND_MOMENT << 40, sensor),
            brightness: 1.0,
        };
        self.images(&(0..self.sensors().len()).map(job).collect::<Vec<_>>()).into_iter().map(Arc::new).collect()
    }

    /// Computes the noise seed of a camera's frame at a `moment`.
    fn frame_noise_seed(&self, moment: u64, camera: usize) -> u64 {
        self.noise_seed ^ (moment << 8) ^ camera as u64
    }

    /// Returns the sensors, one per camera.
    pub fn sensors(&self) -> &[Sensor] {
        self.renderer.sensors()
    }

    /// Captures one image of every camera. `pads` are `world_from_pad`, `forces` the normal forces on them (N), and
    /// `objects` everything that may press (`world_from_object`).
    pub fn capture(
        &mut self,
        hand: &Hand,
        time: f64,
        pads: &[Isometry3<f64>],
        forces: &[f64],
        objects: &[(&ObjectShape, Isometry3<f64>)],
    ) -> Vec<TactileFrame> {
        self.capture_loads(hand, time, &PadLoads { pads, forces, objects, self_loads: &[] })
    }

    /// Captures one image of every camera, with the pads under `loads`.
    pub fn capture_loads(&mut self, hand: &Hand, time: f64, loads: &PadLoads) -> Vec<TactileFrame> {
        self.sequence += 1;
        if self.sensors().is_empty() {
            return Vec::new();
        }
        let side = self.reduced.as_ref().map_or(IMAGE_SIZE, |reduced| reduced[0].raster().side());
        let pressed: Vec<Option<Vec<IndentationMap>>> =
            hand.pads.par_iter().enumerate().map(|(n, _)| press_all(hand, n, side, loads)).collect();
        // Seed by time, not by count, so that additional requests for images change nothing.
        let moment = (time * 1e4).round() as u64;
        let (mut jobs, mut frames, idle) = (Vec::new(), Vec::new(), IndentationMap::idle());
        let frame = |camera: usize, image| TactileFrame { camera, time, sequence: self.sequence, image };
        for (pad, maps) in hand.pads.iter().zip(&pressed) {
            for (n, &camera) in pad.cameras.iter().enumerate() {
                let indentation = maps.as_ref().map(|maps| &maps[n]).or(self.drift.as_ref().map(|_| &idle));
                match indentation {
                    Some(indentation) => {
                        let noise = self.frame_noise_seed(moment, camera);
                        let brightness = self.drift.as_ref().map_or(1.0, |drift| drift.brightness(camera, time));
                        jobs.push(RenderJob { sensor: camera, indentation, noise_seed: noise, brightness });
                    }
                    None => frames.push(frame(camera, self.background(camera))),
                }
            }
        }
        let images = self.images(&jobs).into_iter().zip(&jobs);
        frames.extend(images.map(|(image, job)| frame(job.sensor, Arc::new(image))));
        frames.sort_by_key(|frame| frame.camera);
        frames
    }

    /// Renders the images. If the GPU fails, reports that and renders them on the CPU.
    fn images(&self, jobs: &[RenderJob<'_>]) -> Vec<TactileImage> {
        if let Some(reduced) = &self.reduced {
            let image = |job: &RenderJob<'_>| {
                let (sensor, mut rng) = (&self.sensors()[job.sensor], ChaCha8Rng::seed_from_u64(job.noise_seed));
                reduced[job.sensor].render_with_brightness(sensor, job.indentation, job.brightness, &mut rng)
            };
            return jobs.par_iter().map(image).collect();
        }
        let on_cpu = |error: OpticsError| {
            let _ = writeln!(std::io::stderr(), "{error}; rendering these tactile images on the CPU");
            let image = |job: &RenderJob<'_>| {
                let mut rng = ChaCha8Rng::seed_from_u64(job.noise_seed);
                self.sensors()[job.sensor].render_with_brightness(job.indentation, job.brightness, &mut rng)
            };
            jobs.par_iter().map(image).collect()
        };
        self.renderer.render(jobs).unwrap_or_else(on_cpu)
    }
}

/// Computes the indentation of a pad by objects and by the hand itself: one map of `side` x `side` pixels per camera,
/// `None` without load. Shapes with their own forces are pressed in one by one, and every pixel shows the deepest of
/// them, because their contacts lie side by side.
fn press_all(hand: &Hand, index: usize, side: usize, loads: &PadLoads) -> Option<Vec<IndentationMap>> {
    let press = |force, objects: &[(&ObjectShape, Isometry3<f64>)]| {
        press_pad(hand, (index, side), &loads.pads[index], force, objects)
    };
    let objects = press(loads.forces[index], loads.objects);
    let own = loads.self_loads.iter().filter(|load| load.pad == index);
    let own = own.filter_map(|load| press(load.force, &[(&load.shape, load.pose)]));
    objects.into_iter().chain(own).reduce(|a, b| a.iter().zip(&b).map(|(a, b)| a.pixelwise_max(b)).collect())
}

/// Computes the indentation of a pad under one `force` (N), one map per camera; `None` without load.
fn press_pad(
    hand: &Hand,
    (index, side): (usize, usize),
    world_from_pad: &Isometry3<f64>,
    force: f64,
    objects: &[(&ObjectShape, Isometry3<f64>)],
) -> Option<Vec<IndentationMap>> {
    let pad = &hand.pads[index];
    if force < MIN_FORCE {
        return None;
    }
    let rasters: Vec<Raster> =
        pad.cameras.iter().map(|camera| Raster::with_side(&hand.cameras[*camera], side)).collect();
    let window = rasters.iter().fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(low, high), raster| {
        let ((left, top), (right, bottom)) = (raster.pixel_center(0, 0), raster.pixel_center(side - 1, side - 1));
        ([low[0].min(left), low[1].min(bottom)], [high[0].max(right), high[1].max(top)])
    });
    let half = 0.5 * pad.h.hypot(pad.w);
    let near: Vec<Underside> = objects
        .iter()
        .map(|(shape, pose)| (*shape, pose.inverse() * world_from_pad, shape.bounding_radius()))
        .filter(|(_, object_from_pad, radius)| object_from_pad.translation.vector.norm() < radius + half + OBJECT_REACH)
        .map(|(shape, object_from_pad, radius)| Underside::new(shape, object_from_pad, radius, window))
        .collect();
    let lowest = |x: f64, y: f64| near.iter().filter_map(|object| object.height(x, y)).reduce(f64::min);
    // Only a shape with a broken ray query can fail here. Its pad then shows nothing rather than something wrong.
    press_rasters(pad, &rasters, &GelFoundation::winkler(&hand.gel()), force, lowest).ok().map(|pressed| pressed.maps)
}

/// The part of an object that faces a pad.
enum Underside<'a> {
    Mesh(MeshHeightMap),
    /// A shape with ray queries in closed form: the shape, `object_from_pad`, the shape's centre in the pad's frame
    /// (m), and the squared distance from it beyond which a ray surely misses the shape (m2).
    Closed(&'a ObjectShape, Isometry3<f64>, Point3<f64>, f64),
}

impl<'a> Underside<'a> {
    /// Prepares a shape; `radius` is that of its bounding sphere, m, and rays cover the `window` of the pad.
    fn new(shape: &'a ObjectShape, object_from_pad: Isometry3<f64>, radius: f64, window: ([f64; 2], [f64; 2])) -> Self {
        if let ObjectShape::Mesh(mesh) = shape {
            return Self::Mesh(MeshHeightMap::new(mesh, &object_from_pad.inverse(), -RAY_START, window));
        }
        let middle = object_from_pad.inverse_transform_point(&Point3::origin());
        Self::Closed(shape, object_from_pad, middle, (radius * BOUNDING_RADIUS_FACTOR).powi(2))
    }

    /// Returns the lowest point over (x, y), pad frame, m.
    fn height(&self, x: f64, y: f64) -> Option<f64> {
        match self {
            Self::Mesh(relief) => relief.height(x, y),
            Self::Closed(shape, object_from_pad, middle, square) => {
                if (x - middle.x).powi(2) + (y - middle.y).powi(2) >= *square {
                    return None;
                }
                let origin = object_from_pad * Point3::new(x, y, -RAY_START);
                let direction = Unit::new_unchecked(object_from_pad * Vector3::z());
                shape.ray(&origin, &direction).map(|distance| distance - RAY_START)
            }
        }
    }
}
