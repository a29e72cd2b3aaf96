//! A watcher that records a trial in Rerun: the ground truth if it is known, otherwise measurements and estimates.

mod detector;
mod estimates;
mod measured_scene;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Result;
use control::executor::Phase;
use hand_model::ArmVector;
use hand_model::robot::{ServoState, TactileFrame, TactileImage};
use nalgebra::{Isometry3, Vector3};
use scenarios::record::{Condition, TrialRecord};
use sim::robot::GroundTruth;
use telemetry::recorder::{Recorder, RecorderSettings, RecordingTarget};
use telemetry::{DrawnObject, LogLevel, PoseError, SignalFrame, TrialProperties};
use world::objects::ObjectModel;
use world::phase::ordinal;

use self::estimates::RecordedEstimates;
use self::measured_scene::MeasuredScene;
use crate::trial::{Bench, TickView, Watcher};
use robot_backends::TrialTask;

/// Returns the mesh of `object` for drawing, under `name`.
pub fn drawn_object(object: &ObjectModel, name: &str) -> DrawnObject {
    let (vertices, triangles, _) = object.shape.triangles();
    DrawnObject::from_mesh(name, &vertices, &triangles, object.color)
}

/// Logs the poses of robot and objects, the latter by their `names`, and all contacts.
pub fn log_scene(recorder: &mut Recorder, truth: &GroundTruth, names: &[String]) -> Result<()> {
    recorder.set_time(truth.time);
    let inverse = truth.palm.inverse();
    let hand: Vec<Isometry3<f64>> = truth.hand_links.iter().map(|link| inverse * link).collect();
    recorder.log_robot(&truth.arm_links, &truth.palm, &hand)?;
    for (name, pose) in names.iter().zip(&truth.objects) {
        recorder.log_object(name, pose)?;
    }
    let points: Vec<_> = truth.contacts.iter().map(|contact| contact.point).collect();
    let forces: Vec<_> = truth.contacts.iter().map(|contact| contact.force).collect();
    let between = truth.object_contacts.iter().map(|contact| (contact.point, Vector3::z() * contact.force));
    recorder.log_contacts(&points, &forces, &between.collect::<Vec<_>>())?;
    Ok(())
}

/// Logs the signals of a moment; `posture` is the arm's reference, rad.
pub fn log_signals(
    recorder: &mut Recorder,
    truth: &GroundTruth,
    servos: &[ServoState],
    posture: &ArmVector,
    pose_errors: Vec<Option<PoseError>>,
) -> Result<()> {
    recorder.log_scalars(&SignalFrame {
        tensions: Some(truth.tensions),
        currents: Some(servos.iter().map(|servo| servo.current).collect()),
        joint_angles: Some(truth.hand.iter().copied().collect()),
        arm_angles: Some(*posture),
        pad_forces: Some(truth.pad_forces.clone()),
        pose_errors,
    })?;
    Ok(())
}

/// Tactile images recorded last: one stays the newest for many ticks.
#[derive(Default)]
pub struct RecordedImages(BTreeMap<usize, Arc<TactileImage>>);

impl RecordedImages {
    /// Logs those images of `newest` that have not been recorded.
    pub fn log(&mut self, recorder: &mut Recorder, newest: &[TactileFrame]) -> Result<()> {
        for frame in newest {
            let known = self.0.insert(frame.camera, frame.image.clone());
            if known.is_none_or(|known| !Arc::ptr_eq(&known, &frame.image)) {
                recorder.log_tactile(frame.camera, &frame.image)?;
            }
        }
        Ok(())
    }
}

/// Wall time of time 0 of a backend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeOrigin {
    /// None: time passes in simulation only.
    Never,
    /// Time passes as on the wall clock, from the first observed moment.
    Now,
    /// This time, ns since 1970.
    At(i64),
}

impl TimeOrigin {
    /// Converts `time` (s) of the backend to wall time, ns since 1970.
    fn wall_time(&mut self, time: f64) -> Option<i64> {
        let since = (time * 1e9) as i64;
        if *self == Self::Now {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
            *self = Self::At(now.as_nanos() as i64 - since);
        }
        match *self {
            Self::At(began) => Some(began + since),
            _ => None,
        }
    }
}

/// Describes the end of a successful trial with this many objects.
fn success_description(objects: usize) -> &'static str {
    match objects {
        1 => "the object held",
        2 => "both objects held",
        _ => "all objects held",
    }
}

/// Records the branch of one condition, after the first grasp that it may share with others.
pub struct Recording {
    recorder: Recorder,
    names: Vec<String>,
    objects: Vec<Arc<ObjectModel>>,
    condition: Condition,
    /// True if the branch shares no first grasp with the others.
    skips_planned_grasp: bool,
    /// True if only this branch is run.
    is_only_branch: bool,
    time_origin: TimeOrigin,
    measured_scene: MeasuredScene,
    branch: Option<Condition>,
    phase: Option<Phase>,
    estimates: RecordedEstimates,
    /// True if the ground truth of the scene is recorded.
    truth: bool,
    recorded_images: RecordedImages,
    /// True if the backend's objects are in the reverse of the combination's order.
    reversed: bool,
    /// True if the last moment was recorded; those of other branches are not.
    is_shown: bool,
}

impl Recording {
    /// Opens the targets for a trial and the branch of its condition. `began` is the wall time of the backend's time 0.
    ///
    /// For backends other than the simulated one, measurements and estimates are shown unless `truth` is requested.
    pub fn open(
        targets: &[RecordingTarget],
        bench: &Bench,
        task: &TrialTask,
        (began, truth): (TimeOrigin, bool),
    ) -> Result<Self> {
        let TrialTask { combination, trial, condition, .. } = *task;
        let plan = &bench.grasp_pairs.pairs[combination];
        let objects = bench.world.models(&plan.objects())?;
        let names: Vec<String> = (0..objects.len()).map(|n| ordinal(n).into_owned()).collect();
        let drawn: Vec<DrawnObject> =
            objects.iter().zip(&names).map(|(object, name)| drawn_object(object, name)).collect();
        let truth = truth || task.robot == "sim";
        let settings = RecorderSettings { truth, ..RecorderSettings::default() };
        let mut recorder = Recorder::open(targets, settings, &bench.world.cell.robot, &drawn)?;
        recorder.log_properties(&TrialProperties {
            combination: format!("{combination}: {}", plan.objects().join(" then ")),
            trial: trial as u64,
            condition: condition.name().to_owned(),
            robot: task.robot.clone(),
            seed: bench.seed,
        })?;
        Ok(Self {
            recorder,
            names,
            objects,
            condition,
            skips_planned_grasp: bench.skips_planned_grasp(condition),
            is_only_branch: task.robot != "sim",
            time_origin: began,
            measured_scene: MeasuredScene::new(&bench.world.cell),
            branch: None,
            phase: None,
            estimates: RecordedEstimates::default(),
            truth,
            recorded_images: RecordedImages::default(),
            reversed: false,
            is_shown: false,
        })
    }

    /// Flushes and closes the targets.
    pub fn finish(self) -> Result<()> {
        Ok(self.recorder.finish()?)
    }

    /// Closes the targets and removes the files.
    pub fn discard(self) -> Result<()> {
        Ok(self.recorder.discard()?)
    }
}

impl Watcher for Recording {
    fn is_active(&self) -> bool {
        true
    }

    fn on_branch(&mut self, condition: Condition) -> Result<()> {
        self.branch = Some(condition);
        Ok(())
    }

    fn on_tick(&mut self, moment: &TickView) -> Result<()> {
        let others = moment.condition.map_or(self.skips_planned_grasp, |condition| condition != self.condition);
        self.is_shown = self.is_only_branch || !others;
        if !self.is_shown {
            return Ok(());
        }
        let recorder = &mut self.recorder;
        let (mut names, mut objects) = (self.names.clone(), self.objects.clone());
        self.reversed = moment.reversed;
        if moment.reversed {
            names.reverse();
            objects.reverse();
        }
        if let Some(wall) = self.time_origin.wall_time(moment.time) {
            recorder.set_wall_time(wall);
        }
        let truth = moment.truth.filter(|_| self.truth);
        match truth {
            Some(truth) => log_scene(recorder, truth, &names)?,
            None => recorder.set_time(moment.time),
        }
        let phase = moment.executor.phase();
        if self.phase != Some(phase) {
            self.phase = Some(phase);
            recorder.log_phase(&phase.name())?;
        }
        let felt = self.estimates.record_estimates(recorder, &names, phase, moment.felt)?;
        let mut errors: Vec<Option<PoseError>> = objects.iter().map(|_| None).collect();
        for (n, truth) in (0..objects.len()).filter_map(|n| Some((n, truth?))) {
            let Some(felt) = felt.iter().find(|felt| felt.object == n) else {
                recorder.log_estimate(&names[n], None)?;
                continue;
            };
            let estimate = felt.estimate.palm_from_object;
            recorder.log_estimate(&names[n], Some(&(truth.palm * estimate)))?;
            let real = truth.palm.inverse() * truth.objects[n];
            errors[n] = Some(PoseError {
                mm: (real.translation.vector - estimate.translation.vector).norm() * 1e3,
                deg: objects[n].symmetry.angle(&real.rotation, &estimate.rotation).to_degrees(),
            });
        }
        if let Some(note) = moment.note {
            recorder.log_text(LogLevel::Info, note)?;
        }
        if let Some(choice) = moment.choice {
            self.estimates.record_decision(recorder, &names[0], choice)?;
        }
        let executor = moment.executor;
        self.recorded_images.log(recorder, executor.motion().newest_images())?;
        match truth {
            // If the policy itself moves the robot, the executor has no reference.
            Some(truth) if self.condition == Condition::External && self.skips_planned_grasp => {
                log_signals(recorder, truth, executor.motion().servos(), &executor.motion().arm().position, errors)
            }
            Some(truth) => {
                log_signals(recorder, truth, executor.motion().servos(), executor.motion().posture(), errors)
            }
            None => self.measured_scene.log(recorder, &names, executor, &felt),
        }
    }

    fn on_outcome(&mut self, record: &TrialRecord) -> Result<()> {
        if record.condition != self.condition {
            return Ok(());
        }
        let text = format!(
            "{}: {}{}",
            record.condition,
            if record.success { success_description(self.objects.len()) } else { "failed" },
            record.cause.map_or_else(String::new, |cause| format!(" ({cause})")),
        );
        self.recorder.log_outcome(&format!("{text}{}", if record.contact { ", contact" } else { "" }))?;
        Ok(())
    }
}
