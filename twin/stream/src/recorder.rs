//! The recorder of one trial: where the data go, and what can be logged.

use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::time::Duration;

use hand_model::robot::TactileImage;
use hand_model::{Arm, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use rerun::log::ChunkBatcherConfig;
use rerun::sink::{FileSink, GrpcSink, LogSink, MultiSink};
use rerun::{Clear, RecordingStream, RecordingStreamBuilder};

use crate::blueprint::{self, Eye};
use crate::error::StreamError;
use crate::mesh::DrawnObject;
use crate::phase::{self, Level, TrialProperties};
use crate::release::{APPLICATION, SIM_TIME, TICK, WALL_TIME};
use crate::scene;
use crate::signals::{self, SignalFrame};
use crate::tactile;
use crate::thin::{Moved, Pace};
use crate::{entities, viewer};

/// Where a recording goes. Any number of targets at once, at most one of which should be live.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    /// A `.rrd` file; an existing one is replaced, its folder is made.
    File(PathBuf),
    /// A viewer that is started now, on this machine.
    Spawn,
    /// A viewer that already runs, `rerun+http://HOST:PORT/proxy`.
    Connect(String),
    /// A server that viewers connect to, at this address.
    Serve(SocketAddr),
}

/// How much is recorded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Poses, Hz.
    pub pose_rate: f64,
    /// Numbers, Hz.
    pub scalar_rate: f64,
    /// Tactile images and height maps, Hz a camera.
    pub image_rate: f64,
    /// Size of a recorded tactile image, pixels.
    pub image_side: usize,
    /// JPEG quality, 1 to 100.
    pub jpeg_quality: u8,
    /// Height that is drawn brightest, m.
    pub height_range: f32,
    /// Heights that nowhere exceed this are drawn as an idle pad, m.
    pub height_idle: f32,
    /// Where the 3D view looks.
    pub eye: Eye,
    /// How long [`Recorder::finish`] waits for slow targets.
    pub flush_timeout: Duration,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            pose_rate: 30.0,
            scalar_rate: 30.0,
            image_rate: 5.0,
            image_side: 120,
            jpeg_quality: 85,
            height_range: 1.0e-3,
            height_idle: 3.0e-5,
            eye: Eye::default(),
            flush_timeout: Duration::from_secs(20),
        }
    }
}

const ROBOT: usize = 0;
const CONTACTS: usize = 1;
const FIRST_OBJECT: usize = 2;

/// Records one trial; see the crate's page. Dropped without [`Recorder::finish`], it still writes what it has.
pub struct Recorder {
    rec: RecordingStream,
    settings: Settings,
    hand: Hand,
    arm_links: usize,
    objects: Vec<DrawnObject>,
    time: f64,
    tick: i64,
    moved: Moved,
    poses: Pace,
    scalars: Pace,
    images: Pace,
    heights: Pace,
    last_image: Vec<Option<TactileImage>>,
    /// Size of the last height map of each camera, and whether it was idle.
    last_height: Vec<Option<([usize; 2], bool)>>,
    no_contacts: bool,
}

impl Recorder {
    /// Records into the file at `path`, with the usual settings.
    pub fn create(
        path: impl AsRef<Path>,
        hand: &Hand,
        arm: &Arm,
        objects: &[DrawnObject],
    ) -> Result<Self, StreamError> {
        Self::open(&[Target::File(path.as_ref().to_owned())], Settings::default(), hand, arm, objects)
    }

    /// Records to `targets`; with none, everything is dropped.
    pub fn open(
        targets: &[Target],
        settings: Settings,
        hand: &Hand,
        arm: &Arm,
        objects: &[DrawnObject],
    ) -> Result<Self, StreamError> {
        let live = targets.iter().any(|target| !matches!(target, Target::File(_)));
        // Long batches make small files; a live view wants short ones.
        let flush_tick = Duration::from_millis(if live { 50 } else { 2000 });
        let rec = open(targets, ChunkBatcherConfig { flush_tick, ..ChunkBatcherConfig::DEFAULT })?;
        blueprint::send(&rec, settings.eye)?;
        scene::log_static(&rec, hand, arm, objects)?;
        tactile::log_static(&rec, hand, settings.image_side)?;
        signals::log_static(&rec, hand, arm, objects)?;
        let mut recorder = Self {
            rec,
            settings,
            hand: hand.clone(),
            arm_links: arm.tree.len(),
            objects: objects.to_vec(),
            time: 0.0,
            tick: -1,
            moved: Moved::default(),
            poses: Pace::new(settings.pose_rate),
            scalars: Pace::new(settings.scalar_rate),
            images: Pace::new(settings.image_rate),
            heights: Pace::new(settings.image_rate),
            last_image: vec![None; hand.cameras.len()],
            last_height: vec![None; hand.cameras.len()],
            no_contacts: true,
        };
        recorder.set_time(0.0);
        Ok(recorder)
    }

    /// Says when what follows was; call it once a tick.
    pub fn set_time(&mut self, sim_time: f64) {
        (self.time, self.tick) = (sim_time, self.tick + 1);
        self.rec.set_duration_secs(SIM_TIME, sim_time);
        self.rec.set_time_sequence(TICK, self.tick);
    }

    /// Says when what follows was on the wall clock, ns since 1970; call it before [`Recorder::set_time`].
    pub fn set_wall_time(&mut self, unix_ns: i64) {
        self.rec.set_timestamp_nanos_since_epoch(WALL_TIME, unix_ns);
    }

    /// What identifies the trial.
    pub fn log_properties(&mut self, properties: &TrialProperties) -> Result<(), StreamError> {
        phase::log_properties(&self.rec, properties)
    }

    /// The robot: `world_from_link` of the arm's links, `world_from_palm`, and `palm_from_link` of the hand's links (both
    /// lists as `Tree::forward` gives them).
    pub fn log_robot(
        &mut self,
        arm_links: &[Isometry3<f64>],
        palm: &Isometry3<f64>,
        hand_links: &[Isometry3<f64>],
    ) -> Result<(), StreamError> {
        if !self.poses.due(ROBOT, self.time) {
            return Ok(());
        }
        for (k, pose) in arm_links.iter().enumerate().take(self.arm_links) {
            self.pose(&entities::arm_link(k), pose)?;
        }
        self.pose(entities::HAND, palm)?;
        let paths: Vec<_> = self.hand.tree.joints.iter().map(|joint| entities::hand_link(&joint.name)).collect();
        for (path, link) in paths.iter().zip(hand_links) {
            self.pose(path, link)?;
        }
        Ok(())
    }

    /// `world_from_object` as it is.
    pub fn log_object(&mut self, name: &str, pose: &Isometry3<f64>) -> Result<(), StreamError> {
        let index = self.object(name)?;
        if self.poses.due(FIRST_OBJECT + 2 * index, self.time) {
            self.pose(&entities::object(name), pose)?;
        }
        Ok(())
    }

    /// `world_from_object` as the robot believes it to be; `None` when it believes nothing.
    pub fn log_estimate(&mut self, name: &str, pose: Option<&Isometry3<f64>>) -> Result<(), StreamError> {
        let index = self.object(name)?;
        let path = entities::estimate(name);
        let Some(pose) = pose else {
            if self.moved.forget(&path) {
                self.rec.log(path.as_str(), &Clear::flat())?;
            }
            return Ok(());
        };
        if !self.moved.knows(&path) {
            self.rec.log(path.as_str(), &scene::ghost(&self.objects[index]))?;
        } else if !self.poses.due(FIRST_OBJECT + 2 * index + 1, self.time) {
            return Ok(());
        }
        self.pose(&path, pose)
    }

    /// Contact forces (N) at points (m), world frame.
    pub fn log_contacts(&mut self, points: &[Point3<f64>], forces: &[Vector3<f64>]) -> Result<(), StreamError> {
        let none = points.is_empty() || forces.is_empty();
        if (none && self.no_contacts) || !self.poses.due(CONTACTS, self.time) {
            return Ok(());
        }
        self.no_contacts = none;
        if none {
            return Ok(self.rec.log(entities::CONTACTS, &Clear::flat())?);
        }
        Ok(self.rec.log(entities::CONTACTS, &scene::forces(points, forces))?)
    }

    /// The image of a camera. An image like the last one is not logged again.
    pub fn log_tactile(&mut self, camera: usize, image: &TactileImage) -> Result<(), StreamError> {
        let name = self.camera(camera)?;
        if self.last_image[camera].as_ref().is_some_and(|last| !tactile::differ(last, image))
            || !self.images.due(camera, self.time)
        {
            return Ok(());
        }
        let bytes = tactile::encode(image, self.settings.image_side, self.settings.jpeg_quality)
            .map_err(|reason| StreamError::Image { what: name.clone(), reason })?;
        self.last_image[camera] = Some(image.clone());
        Ok(self.rec.log(entities::tactile(&name), &tactile::archetype(bytes))?)
    }

    /// The height map (m, row-major, `w` by `h`, row 0 distal) of a camera. An idle one is logged once.
    pub fn log_height(&mut self, camera: usize, heights: &[f32], w: usize, h: usize) -> Result<(), StreamError> {
        let name = self.camera(camera)?;
        let idle = heights.iter().all(|height| height.abs() < self.settings.height_idle);
        let last = self.last_height[camera];
        if last == Some(([w, h], true)) && idle || !self.heights.due(camera, self.time) {
            return Ok(());
        }
        let range = self.settings.height_range;
        let (bytes, place) =
            tactile::height_image(&self.hand, camera, heights, [w, h], range, self.settings.jpeg_quality)
                .map_err(|reason| StreamError::Image { what: name.clone(), reason })?;
        let path = entities::height(&name);
        if last.is_none_or(|(size, _)| size != [w, h]) {
            self.rec.log_static(path.as_str(), &place)?;
        }
        self.last_height[camera] = Some(([w, h], idle));
        Ok(self.rec.log(path, &tactile::archetype(bytes))?)
    }

    /// The numbers of this moment.
    pub fn log_scalars(&mut self, frame: &SignalFrame) -> Result<(), StreamError> {
        if self.scalars.due(0, self.time) { signals::log(&self.rec, frame) } else { Ok(()) }
    }

    /// A new phase of the trial.
    pub fn log_phase(&mut self, phase: &str) -> Result<(), StreamError> {
        phase::log_phase(&self.rec, phase)
    }

    /// A line of the log.
    pub fn log_text(&mut self, level: Level, text: &str) -> Result<(), StreamError> {
        phase::log_text(&self.rec, level, text)
    }

    /// How the trial ended.
    pub fn log_outcome(&mut self, outcome: &str) -> Result<(), StreamError> {
        phase::log_outcome(&self.rec, outcome)
    }

    /// Writes everything to the end and closes; says if something could not be written.
    pub fn finish(self) -> Result<(), StreamError> {
        self.rec.flush_with_timeout(self.settings.flush_timeout)?;
        self.rec.finalize_deferred_sinks();
        Ok(())
    }

    fn pose(&mut self, path: &str, pose: &Isometry3<f64>) -> Result<(), StreamError> {
        if self.moved.check(path, pose) {
            self.rec.log(path, &scene::transform(pose))?;
        }
        Ok(())
    }

    fn object(&self, name: &str) -> Result<usize, StreamError> {
        let index = self.objects.iter().position(|object| object.name == name);
        index.ok_or_else(|| StreamError::Unknown(name.to_owned()))
    }

    fn camera(&self, index: usize) -> Result<String, StreamError> {
        let camera = self.hand.cameras.get(index).ok_or_else(|| StreamError::Unknown(format!("camera {index}")))?;
        Ok(camera.name.clone())
    }
}

/// A recording into all of `targets`, without the clocks that Rerun adds; without targets it takes nothing.
pub(crate) fn open(targets: &[Target], batches: ChunkBatcherConfig) -> Result<RecordingStream, StreamError> {
    let sinks: Vec<Box<dyn LogSink>> = targets.iter().map(sink).collect::<Result<_, _>>()?;
    let rec = RecordingStreamBuilder::new(APPLICATION).enabled(!sinks.is_empty()).batcher_config(batches).buffered()?;
    rec.set_log_time_enabled(false);
    rec.set_log_tick_enabled(false);
    rec.set_sink(Box::new(MultiSink::new(sinks)));
    Ok(rec)
}

fn sink(target: &Target) -> Result<Box<dyn LogSink>, StreamError> {
    let grpc = |address: &str| -> Result<Box<dyn LogSink>, StreamError> {
        let uri = address.parse().map_err(|_| StreamError::Address(address.to_owned()))?;
        Ok(Box::new(GrpcSink::new(uri)))
    };
    match target {
        Target::File(path) => {
            if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
                std::fs::create_dir_all(folder)
                    .map_err(|source| StreamError::Unwritable { path: path.clone(), source })?;
            }
            let unwritable = |source| StreamError::Unwritable { path: path.clone(), source };
            match FileSink::new(path) {
                Ok(file) => Ok(Box::new(file)),
                Err(rerun::sink::FileSinkError::CreateFile { source, .. }) => Err(unwritable(source)),
                Err(error) => Err(unwritable(std::io::Error::other(error))),
            }
        }
        Target::Spawn => grpc(&viewer::spawn()?),
        Target::Connect(address) => grpc(address),
        Target::Serve(address) => {
            // The server reports a busy port only in its own thread; ask here.
            drop(TcpListener::bind(address).map_err(|error| StreamError::Address(format!("{address} ({error})")))?);
            let server = rerun::grpc_server::GrpcServerSink::new(
                &address.ip().to_string(),
                address.port(),
                rerun::ServerOptions::default(),
            )
            .map_err(|_| StreamError::Address(address.to_string()))?;
            Ok(Box::new(server))
        }
    }
}
