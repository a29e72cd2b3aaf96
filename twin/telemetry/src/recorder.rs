//! Recorder of one trial: targets, rates, and everything that can be logged.

mod pose_estimates;
mod reference_model;
mod touch;

use std::path::Path;
use std::time::Duration;

use hand_model::robot::TactileImage;
use hand_model::{DigitVector, RobotModel};

use nalgebra::{Isometry3, Point3, Vector3};
use rerun::log::ChunkBatcherConfig;
use rerun::{Clear, RecordingStream, TextDocument};

pub use self::reference_model::ReferenceFrame;
use crate::blueprint;
use crate::error::TelemetryError;
use crate::mesh::DrawnObject;
use crate::phase::{self, LogLevel, TrialProperties};
use crate::rate_limit::{LastPoses, RateLimiter};
use crate::release::{SIM_TIME, TICK, WALL_TIME};
use crate::signals::{self, SignalFrame};
use crate::sink::OpenRecording;
pub use crate::sink::RecordingTarget;
use crate::state_page::{ScoredCandidate, StatePage};
use crate::tactile_changes::TactileChanges;
use crate::{entities, hand_mesh, pose_estimate, scene, tactile};

/// Rates, sizes and content of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecorderSettings {
    /// Rate of poses, Hz.
    pub pose_rate: f64,
    /// Rate of scalar signals, Hz.
    pub scalar_rate: f64,
    /// Rate of tactile images and height maps, Hz per camera.
    pub image_rate: f64,
    /// Side of a recorded tactile image, pixels.
    pub image_side: usize,
    /// Side of a recorded difference from the untouched image, pixels.
    pub change_side: usize,
    /// JPEG quality, 1 to 100.
    pub jpeg_quality: u8,
    /// Height that is drawn brightest, m.
    pub height_range: f32,
    /// Idle threshold, m. A height map that stays below it everywhere is drawn as an idle pad.
    pub height_idle: f32,
    /// Rate of cable shapes and cable colours, Hz.
    pub cable_rate: f64,
    /// True if the true scene is recorded beside measurements and estimates.
    pub truth: bool,
    /// Time limit of [`Recorder::finish`] for slow targets.
    pub flush_timeout: Duration,
}

impl Default for RecorderSettings {
    fn default() -> Self {
        Self {
            pose_rate: 30.0,
            scalar_rate: 30.0,
            image_rate: 5.0,
            image_side: 120,
            change_side: 56,
            jpeg_quality: 85,
            height_range: 1.0e-3,
            height_idle: 3.0e-5,
            cable_rate: 5.0,
            truth: true,
            flush_timeout: Duration::from_secs(20),
        }
    }
}

const ROBOT_KEY: usize = 0;
const CONTACTS_KEY: usize = 1;
const CABLES_KEY: usize = 2;
const PAGE_KEY: usize = 3;
const REFERENCE_KEY: usize = 4;
const REFERENCE_OBJECT_KEY: usize = 5;
const FIRST_OBJECT_KEY: usize = 6;
/// Refresh rate of the page on the current state, Hz.
const PAGE_RATE: f64 = 0.5;

/// Recorder of one trial; see the crate's page. If dropped without [`Recorder::finish`], it still writes its data.
pub struct Recorder {
    rec: RecordingStream,
    opened: OpenRecording,
    settings: RecorderSettings,
    robot: RobotModel,
    arm_links: usize,
    objects: Vec<DrawnObject>,
    time: f64,
    tick: i64,
    last_poses: LastPoses,
    poses: RateLimiter,
    scalars: RateLimiter,
    images: RateLimiter,
    heights: RateLimiter,
    last_image: Vec<Option<TactileImage>>,
    /// Size of the last height map of each camera, and true if it was idle.
    last_height: Vec<Option<([usize; 2], bool)>>,
    no_contacts: bool,
    changes: TactileChanges,
    cables: RateLimiter,
    /// Drawn cable tensions, in colour steps.
    cable_steps: DigitVector<u8>,
    pages: RateLimiter,
    state_page: StatePage,
    page: String,
    /// Last touch of each object with its covariance.
    felt: Vec<Option<pose_estimate::LastContact>>,
    /// True if a reference model is shown; then the object estimated to be in its hand.
    reference_model: bool,
    reference_object: Option<usize>,
    /// True for each shown one: the rejected trajectory, the chosen one, and the closest approach.
    shown_paths: [bool; 3],
}

impl Recorder {
    /// Records into the file at `path`, with the default settings.
    pub fn create(path: impl AsRef<Path>, robot: &RobotModel, objects: &[DrawnObject]) -> Result<Self, TelemetryError> {
        Self::open(&[RecordingTarget::File(path.as_ref().to_owned())], RecorderSettings::default(), robot, objects)
    }

    /// Records to `targets`. Without targets everything is dropped.
    pub fn open(
        targets: &[RecordingTarget],
        settings: RecorderSettings,
        robot: &RobotModel,
        objects: &[DrawnObject],
    ) -> Result<Self, TelemetryError> {
        let live = targets.iter().any(|target| !matches!(target, RecordingTarget::File(_)));
        // Long batches make small files; a live view needs short ones.
        let flush_tick = Duration::from_millis(if live { 50 } else { 30_000 });
        let opened = OpenRecording::new(targets, ChunkBatcherConfig { flush_tick, ..ChunkBatcherConfig::DEFAULT })?;
        let rec = opened.rec.clone();
        blueprint::send(&rec)?;
        // Without ground truth the true poses of the objects are unknown, so only their estimates are drawn.
        scene::log_static(&rec, robot, if settings.truth { objects } else { &[] })?;
        tactile::log_static(&rec, &robot.hand)?;
        signals::log_static(&rec, robot, objects)?;
        let mut recorder = Self {
            rec,
            opened,
            settings,
            robot: robot.clone(),
            arm_links: robot.arm.tree.len(),
            objects: objects.to_vec(),
            time: 0.0,
            tick: -1,
            last_poses: LastPoses::default(),
            poses: RateLimiter::new(settings.pose_rate),
            scalars: RateLimiter::new(settings.scalar_rate),
            images: RateLimiter::new(settings.image_rate),
            heights: RateLimiter::new(settings.image_rate),
            last_image: vec![None; robot.hand.cameras.len()],
            last_height: vec![None; robot.hand.cameras.len()],
            no_contacts: true,
            changes: TactileChanges::new(robot.hand.cameras.len()),
            cables: RateLimiter::new(settings.cable_rate),
            cable_steps: DigitVector::new(),
            pages: RateLimiter::new(PAGE_RATE),
            state_page: StatePage::new(settings.truth),
            page: String::new(),
            felt: vec![None; objects.len()],
            reference_model: false,
            reference_object: None,
            shown_paths: [false; 3],
        };
        recorder.set_time(0.0);
        recorder.log_pads()?;
        Ok(recorder)
    }

    /// Sets the simulation time (s) of all data that follow, and counts a tick. Call it once per tick.
    pub fn set_time(&mut self, sim_time: f64) {
        (self.time, self.tick) = (sim_time, self.tick + 1);
        self.rec.set_duration_secs(SIM_TIME, sim_time);
        self.rec.set_time_sequence(TICK, self.tick);
    }

    /// Sets the wall-clock time of all data that follow, ns since 1970. Call it before [`Recorder::set_time`].
    pub fn set_wall_time(&mut self, unix_ns: i64) {
        self.rec.set_timestamp_nanos_since_epoch(WALL_TIME, unix_ns);
    }

    /// Logs the identification of the trial.
    pub fn log_properties(&mut self, properties: &TrialProperties) -> Result<(), TelemetryError> {
        self.state_page
            .set_title(&format!("{} · {} on {}", properties.combination, properties.condition, properties.robot));
        phase::log_properties(&self.rec, properties)
    }

    /// Logs the robot: `world_from_link` of the arm's links, `world_from_palm`, and `palm_from_link` of the hand's
    /// links (both lists as returned by `Tree::forward`).
    pub fn log_robot(
        &mut self,
        arm_links: &[Isometry3<f64>],
        palm: &Isometry3<f64>,
        hand_links: &[Isometry3<f64>],
    ) -> Result<(), TelemetryError> {
        if !self.poses.due(ROBOT_KEY, self.time) {
            return Ok(());
        }
        for (k, pose) in arm_links.iter().enumerate().take(self.arm_links) {
            self.log_pose_if_moved(&entities::arm_link(k), pose)?;
        }
        self.log_pose_if_moved(entities::HAND, palm)?;
        self.log_pose_if_moved(entities::FOLLOW, &scene::follow_frame(palm))?;
        let paths: Vec<_> = self.robot.hand.tree.joints.iter().map(|joint| entities::hand_link(&joint.name)).collect();
        let mut moved = false;
        for (path, link) in paths.iter().zip(hand_links) {
            moved |= self.log_pose_if_moved(path, link)?;
        }
        self.log_cables(hand_links, moved)?;
        self.refresh_page(false)
    }

    /// Logs the cables from guide to guide, coloured by the tensions logged last.
    fn log_cables(&mut self, hand_links: &[Isometry3<f64>], moved: bool) -> Result<(), TelemetryError> {
        if moved && self.cables.due(CABLES_KEY, self.time) {
            let runs = hand_mesh::cables(&self.robot.hand, hand_links);
            self.rec.log(entities::CABLES, &scene::cable_lines(&runs, &self.cable_steps))?;
        }
        Ok(())
    }

    /// Logs the true pose `world_from_object`.
    pub fn log_object(&mut self, name: &str, pose: &Isometry3<f64>) -> Result<(), TelemetryError> {
        let index = self.object_index(name)?;
        if self.settings.truth && self.poses.due(FIRST_OBJECT_KEY + 2 * index, self.time) {
            self.log_pose_if_moved(&entities::object(name), pose)?;
        }
        Ok(())
    }

    /// Logs the candidates of a decision; an empty list when it is over.
    pub fn log_candidates(&mut self, options: Vec<ScoredCandidate>) -> Result<(), TelemetryError> {
        self.state_page.set_candidates(options);
        self.refresh_page(true)
    }

    /// Logs contact forces (N, world frame) at points (m) on the hand, and between objects (pairs of point and force).
    pub fn log_contacts(
        &mut self,
        points: &[Point3<f64>],
        forces: &[Vector3<f64>],
        between: &[(Point3<f64>, Vector3<f64>)],
    ) -> Result<(), TelemetryError> {
        let none = (points.is_empty() || forces.is_empty()) && between.is_empty();
        if (none && self.no_contacts) || !self.settings.truth || !self.poses.due(CONTACTS_KEY, self.time) {
            return Ok(());
        }
        self.no_contacts = none;
        if none {
            return Ok(self.rec.log(entities::CONTACTS, &Clear::flat())?);
        }
        Ok(self.rec.log(entities::CONTACTS, &scene::force_arrows(points, forces, between))?)
    }

    /// Logs the scalar signals of this moment.
    pub fn log_scalars(&mut self, frame: &SignalFrame) -> Result<(), TelemetryError> {
        if let Some(tensions) = frame.tensions {
            let pulled: DigitVector<u8> = tensions.iter().map(|tension| scene::tension_step(*tension)).collect();
            if pulled != self.cable_steps && self.cables.due(CABLES_KEY + 1, self.time) {
                self.cable_steps = pulled;
                self.rec.log(entities::CABLES, &scene::cable_colors(&pulled))?;
            }
        }
        if self.scalars.due(0, self.time) { signals::log(&self.rec, frame) } else { Ok(()) }
    }

    /// Logs the start of a phase of the trial.
    pub fn log_phase(&mut self, phase: &str) -> Result<(), TelemetryError> {
        self.state_page.set_phase(phase);
        self.refresh_page(true)?;
        phase::log_phase(&self.rec, phase)
    }

    /// Logs a line of text.
    pub fn log_text(&mut self, level: LogLevel, text: &str) -> Result<(), TelemetryError> {
        self.state_page.add(self.time, text);
        self.refresh_page(true)?;
        phase::log_text(&self.rec, level, text)
    }

    /// Logs the outcome of the trial.
    pub fn log_outcome(&mut self, outcome: &str) -> Result<(), TelemetryError> {
        self.state_page.set_outcome(outcome);
        self.refresh_page(true)?;
        phase::log_outcome(&self.rec, outcome)
    }

    /// Refreshes the page on the current state if it is `due` or its interval has passed.
    fn refresh_page(&mut self, due: bool) -> Result<(), TelemetryError> {
        if !self.pages.due(PAGE_KEY, self.time) && !due {
            return Ok(());
        }
        let page = self.state_page.page(self.time);
        if page != self.page {
            self.rec.log(entities::STATE_PAGE, &TextDocument::from_markdown(page.clone()))?;
            self.page = page;
        }
        Ok(())
    }

    /// Flushes everything and closes the recording. Returns an error if something could not be written.
    pub fn finish(self) -> Result<(), TelemetryError> {
        self.opened.close(self.settings.flush_timeout)
    }

    /// Closes the recording and removes its files.
    pub fn discard(self) -> Result<(), TelemetryError> {
        self.opened.discard()
    }

    /// Logs a pose if it has moved, and returns true if it has.
    fn log_pose_if_moved(&mut self, path: &str, pose: &Isometry3<f64>) -> Result<bool, TelemetryError> {
        let moved = self.last_poses.has_moved(path, pose);
        if moved {
            self.rec.log(path, &scene::transform(pose))?;
        }
        Ok(moved)
    }

    fn object_index(&self, name: &str) -> Result<usize, TelemetryError> {
        let index = self.objects.iter().position(|object| object.name == name);
        index.ok_or_else(|| TelemetryError::Unknown(name.to_owned()))
    }

    fn camera_name(&self, index: usize) -> Result<String, TelemetryError> {
        let camera =
            self.robot.hand.cameras.get(index).ok_or_else(|| TelemetryError::Unknown(format!("camera {index}")))?;
        Ok(camera.name.clone())
    }
}
