//! Setup of a trial: its grasp pair, noise, disturbances and backend.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use control::detection::DetectedObject;
use control::executor::Phase;
use control::outage::Outage;
use control::policy::OrderComparison;
use dexterous_grasping::Repertoire;
use grasp_verification::ball_sizes;
use grasp_verification::grasp_pair::{GraspPair, GraspPairTable, PlannedGrasps};
use grasp_verification::rollout::{RolloutSnapshot, TrialStart};
use scenarios::detector_model::DetectorModel;
use scenarios::disturbance::Disturbances;
use scenarios::effects::Effect;
use scenarios::generator::trial_rng;
use scenarios::noise::{ObjectNoise, TrialNoise, draw_shifts};
use scenarios::referee::{Referee, RefereeLimits};
use sim::tactile::BrightnessDrift;
use tactile_perception::{TouchPipeline, backgrounds};
use world::layout::MAX_OBJECTS;
use world::objects::ObjectModel;

use super::capabilities::PolicyCapabilities;
use super::disturbance::{Disturber, scaled_objects};
use super::run::Run;
use super::shared::Bench;
use super::simulated_detector::{DetectionNoise, PoseHistory};
use super::watcher::Watcher;
use robot_backends::{Backend, BackendFactory, Detection, TrialSetup, TrialTask};

/// Interval between the tactile images of a watched trial, s.
const WATCH_PERIOD: f64 = 0.2;
/// The same with a real backend and no fault detection, s: its sessions keep every pixel, 3.1 MB per capture.
const REAL_WATCH_PERIOD: f64 = 1.0;
/// Interval longer than any trial, s: a single capture of the untouched pads.
const SINGLE_CAPTURE_PERIOD: f64 = 1e6;
/// Usual arrival time of the images of a first capture, s, and the number of waits for them.
const FIRST_CAPTURE_WAIT: (f64, u32) = (0.5, 10);

/// Initial conditions of a trial.
#[derive(Clone)]
pub struct InitialConditions<'a> {
    /// Grasp pair of the combination.
    pub grasp_pair: GraspPair,
    /// Repertoire of the grasps that the pair names.
    pub repertoire: &'a Repertoire,
    /// Errors of the arm and of the first detection.
    pub noise: TrialNoise,
    /// Seed of the cameras' noise.
    pub camera_noise: u64,
    /// Drift of the cameras' brightness. Without it, idle pads show their backgrounds.
    pub drift: Option<BrightnessDrift>,
    /// Disturbances in addition to noise.
    pub disturbances: Disturbances,
    /// Reason for which `grasp_pair` reverses the planned order of the objects, if it does.
    pub reordered: Option<OrderComparison>,
}

/// A trial after its first grasp, or at its start.
#[derive(Clone)]
pub struct PreparedTrial {
    /// Backend, controller and referee, with the controller waiting for a decision.
    pub run: Run,
    /// The objects as known to the controller.
    pub objects: Vec<Arc<ObjectModel>>,
    /// Planned grasps.
    pub grasps: PlannedGrasps,
    /// Reason for a reversed order of the objects, if any.
    pub reordered: Option<OrderComparison>,
    /// Perception with the backgrounds that the backend itself has shown, or with frames from before the trial. `None`
    /// to use the bench's, if the backend is simulated and its idle pads show their backgrounds.
    pub pipeline: Option<TouchPipeline>,
    /// Standard error that the first detection reports for each object, m.
    pub detection_errors: [Option<f64>; MAX_OBJECTS],
}

impl PreparedTrial {
    /// Sets the object poses to those that the backend's object detector reports.
    fn detect_objects(mut self) -> Result<Self> {
        match self.update_detections() {
            Ok(()) => Ok(self),
            Err(error) => {
                // The recording is finished; the first error is the one to report.
                let _ = self.run.snapshot.robot.finish(None, Some(&format!("{error:#}")));
                Err(error)
            }
        }
    }

    fn update_detections(&mut self) -> Result<()> {
        let RolloutSnapshot { robot, executor } = &mut self.run.snapshot;
        let mut seen = |object: usize| {
            let known = &self.objects[object];
            let glance =
                Detection { object, noise: ObjectNoise::default(), pose_at_capture: None, camera_position: None };
            let sighted = robot.detect(&glance)?.with_context(|| {
                format!("{}: found it occluded, expected all objects in sight before the trial", known.name)
            })?;
            self.detection_errors[object] = sighted.sigma;
            anyhow::Ok(DetectedObject::from_pose(known, &sighted.pose))
        };
        for object in 0..self.objects.len() {
            executor.update_detection(object, seen(object)?);
        }
        Ok(())
    }
}

impl PreparedTrial {
    /// Returns the prior knowledge of a policy about the trial.
    pub fn prior_knowledge(&self) -> PriorKnowledge<'_> {
        PriorKnowledge {
            objects: &self.objects,
            grasps: &self.grasps,
            reordered: self.reordered,
            sighted: self.detection_errors,
        }
    }
}

/// Prior knowledge of a policy before a trial.
#[derive(Clone, Copy)]
pub struct PriorKnowledge<'a> {
    /// The objects, in the order in which they are grasped.
    pub objects: &'a [Arc<ObjectModel>],
    /// Planned grasps.
    pub grasps: &'a PlannedGrasps,
    /// Reason for this order, if it is not the planned one.
    pub reordered: Option<OrderComparison>,
    /// Standard error that the first detection reports for each object, m.
    pub sighted: [Option<f64>; MAX_OBJECTS],
}

/// Backend of a trial: a simulated one of its own (`None`), or one from a factory for a task.
pub type TrialBackendSource<'a> = Option<(&'a mut dyn BackendFactory, &'a TrialTask)>;

impl<'a> InitialConditions<'a> {
    /// Sets up a combination as planned, undisturbed.
    pub fn planned(bench: &'a Bench, combination: usize, noise: TrialNoise, camera_noise: u64) -> Self {
        let (repertoire, plan) = (intact_grasps(bench).0, planned_pair(bench, combination).clone());
        let disturbances = Disturbances::default();
        Self { grasp_pair: plan, repertoire, noise, camera_noise, drift: None, disturbances, reordered: None }
    }

    /// Sets up a trial with its noise and disturbances. Also returns the generators of its later detections.
    pub fn noisy(bench: &'a Bench, combination: usize, trial: usize) -> Result<(Self, DetectionNoise)> {
        let (noise, camera_noise, detections) = draw_noise(bench, combination, trial)?;
        let mut setup = Self::planned(bench, combination, noise, camera_noise).with_drift(bench, combination, trial);
        setup.disturbances = bench.world.scenario.disturbance.clone();
        if let Some(sweep) = &setup.disturbances.size_sweep {
            setup.grasp_pair = ball_sizes::pair_for_trial(&setup.grasp_pair, sweep, trial);
        }
        Ok((setup, detections))
    }

    /// Adds the camera drift drawn for a trial, if the scenario has one.
    pub fn with_drift(mut self, bench: &Bench, combination: usize, trial: usize) -> Self {
        self.drift = bench.world.scenario.effects.pads.map(|pads| {
            let mut rng = Effect::Pads.draw_rng(bench.seed, combination, trial);
            BrightnessDrift::new(
                pads.draw_drift_rates(bench.world.cell.robot.hand.cameras.len(), &mut rng),
                pads.background_age,
            )
        });
        self
    }

    /// Returns the setup of the same trial for a policy informed of the digits without power.
    pub fn without_digits(&self, bench: &'a Bench, combination: usize) -> Self {
        let (plan, repertoire) = (bench.grasp_pairs.pairs[combination].clone(), &bench.repertoire);
        Self {
            grasp_pair: plan,
            repertoire,
            disturbances: self.disturbances.clone(),
            drift: self.drift.clone(),
            ..*self
        }
    }

    /// Returns the setup of the same trial in the order that a policy with these `means` chooses: the other object
    /// first, if its expected score is higher. The true poses, errors and properties of the objects stay those of the
    /// planned order. A scenario that disturbs the first or the second object keeps the planned order.
    pub fn reordered_for(&self, bench: &Bench, means: PolicyCapabilities) -> Result<Self> {
        // Grasp pairs tried after a single hold are not comparable with those verified after many.
        let comparable =
            |reversed: &&GraspPair| self.grasp_pair.verification.is_none() || reversed.verification.is_some();
        let reversed = self.grasp_pair.reversed.as_deref().filter(comparable);
        let Some(reversed) = reversed.filter(|_| self.disturbances.is_none()) else {
            return Ok(self.clone());
        };
        let other = Self { grasp_pair: reversed.clone(), noise: self.noise.with_swapped_objects(), ..self.clone() };
        let [planned, promised] = [self, &other].map(|setup| bench.expected_score(setup, means));
        let reordered = OrderComparison::if_better(planned?, promised?);
        Ok(if reordered.is_some() { Self { reordered, ..other } } else { self.clone() })
    }

    /// Returns the objects of the grasp pair.
    pub fn objects(&self, bench: &Bench) -> Result<Vec<Arc<ObjectModel>>> {
        bench.world.models(&self.grasp_pair.objects())
    }

    /// Creates backend, controller and referee of a trial that is about to begin.
    pub fn begin(&self, bench: &Bench, source: TrialBackendSource, watched: bool) -> Result<PreparedTrial> {
        let reversed = self.reordered.map(|_| bench.world.with_places_swapped());
        let world = reversed.as_ref().unwrap_or(&bench.world);
        let planned = self.grasp_pair.grasps(&world.cell.robot.hand, self.repertoire)?;
        let objects = self.objects(bench)?;
        if source.is_some() {
            // A backend in real time does not wait for this preparation later.
            bench.prepare_objects(&objects);
        }
        let disturber = Disturber::new(&self.disturbances, &objects);
        let sized = scaled_objects(&objects, &self.disturbances.size_factors())?;
        let real = sized.iter().zip(&self.noise.object_instances);
        let real = real.map(|(object, one)| Ok(one.apply_to(object)?)).collect::<Result<Vec<_>>>()?;
        let grasps = planned.planned();
        let mut board = bench.cameras.with_noise(self.camera_noise);
        let mut pipeline = None;
        if let Some(drift) = &self.drift {
            board = board.drifting(drift.clone());
            pipeline = Some(bench.pipeline.with_backgrounds(board.background_frames())?);
        }
        let eyes = source.as_ref().is_some_and(|(_, task)| task.places.detector);
        let watched = source.as_ref().map_or(watched, |(_, task)| task.images_throughout);
        let in_reality = source.as_ref().filter(|(body, _)| body.is_real());
        let mirrored = in_reality.is_some_and(|(_, task)| task.detects_faults);
        let period = if in_reality.is_some() && !mirrored { REAL_WATCH_PERIOD } else { WATCH_PERIOD };
        let noise = disturber.first_detection_noise(&self.noise);
        let start =
            TrialStart { protocol: world.protocol(), grasps: &grasps, noise: &noise, arm: world.cell.ready_posture };
        let RolloutSnapshot { mut robot, executor } = RolloutSnapshot::at_start(world, &start, &real, board)?;
        disturber.prepare(&mut robot);
        let robot = match source {
            None => Backend::Simulated(Box::new(robot)),
            Some((source, task)) => {
                let places = world.object_poses(&objects, &noise);
                let named = objects.iter().zip(places).map(|(object, place)| (object.name.as_str(), place)).collect();
                Backend::open(source, &TrialSetup { task, objects: named }, robot, env!("CARGO_PKG_VERSION"))?
            }
        };
        let mut snapshot = RolloutSnapshot { robot, executor };
        if watched || mirrored {
            snapshot.executor.request_images_every(period);
        } else if !snapshot.robot.is_cloneable() {
            snapshot.executor.request_images_every(SINGLE_CAPTURE_PERIOD);
        }
        let protocol = &world.scenario.protocol;
        let limits = RefereeLimits { hold: protocol.hold_time, trial: protocol.time_limit };
        let referee = Referee::new(world.scenario.referee, limits);
        let latency = world.scenario.effects.detector.map_or(0.0, |eyes| eyes.latency);
        let history = PoseHistory::new(latency);
        let reversed = self.reordered.is_some();
        let run = Run {
            snapshot,
            referee,
            disturber,
            history,
            profile: bench.profile.clone(),
            reversed,
            continues_after_faults: bench.continues_after_faults,
            fault: None,
            outage: Outage::default(),
        };
        let sighted = [None; MAX_OBJECTS];
        let start = PreparedTrial {
            run,
            objects,
            grasps: planned,
            reordered: self.reordered,
            pipeline,
            detection_errors: sighted,
        };
        if eyes { start.detect_objects() } else { Ok(start) }
    }

    /// Starts a trial at rest, with the controller waiting for a policy. A backend that is not simulated shows its
    /// untouched pads.
    pub fn begin_at_rest(
        &self,
        bench: &Bench,
        source: TrialBackendSource,
        watcher: &mut dyn Watcher,
    ) -> Result<PreparedTrial> {
        let start = self.begin(bench, source, watcher.is_active())?;
        finish_on_error(start, |run| {
            if run.snapshot.robot.is_cloneable() {
                return Ok(None);
            }
            let (time, most) = FIRST_CAPTURE_WAIT;
            for _ in 0..most {
                run.wait(time, &[], None, watcher)?;
                if run.snapshot.executor.motion().newest_images().len() >= bench.world.cell.robot.hand.cameras.len() {
                    break;
                }
            }
            with_backend_backgrounds(run, &bench.pipeline).map(Some)
        })
    }

    /// Runs up to the decision after the first grasp. A backend that is not simulated shows its untouched pads on the
    /// way to the first object, if images will matter.
    pub fn run_first_grasp(
        &self,
        bench: &Bench,
        source: TrialBackendSource,
        watcher: &mut dyn Watcher,
    ) -> Result<PreparedTrial> {
        let condition = source.as_ref().map(|(_, task)| task.condition);
        let sees = condition.and_then(PolicyCapabilities::for_condition).is_some_and(PolicyCapabilities::use_images);
        let start = self.begin(bench, source, watcher.is_active())?;
        finish_on_error(start, |run| {
            run.snapshot.executor.take_planned(0)?;
            let mut own = None;
            if !run.snapshot.robot.is_cloneable() {
                run.run_until(|phase| phase.has_begun_grasp(0), &[], None, watcher)?;
                own = sees.then(|| with_backend_backgrounds(run, &bench.pipeline)).transpose()?;
            }
            run.run_until(Phase::waits_for_decision, &[], None, watcher)?;
            Ok(own)
        })
    }
}

/// Runs `first_grasp` on `start`, and adopts the perception that it returns, if any.
fn finish_on_error(
    mut start: PreparedTrial,
    first_grasp: impl FnOnce(&mut Run) -> Result<Option<TouchPipeline>>,
) -> Result<PreparedTrial> {
    match first_grasp(&mut start.run) {
        Ok(shown) => Ok(PreparedTrial { pipeline: shown.or(start.pipeline), ..start }),
        Err(error) => {
            // The recording is finished in any case; the first error is the one to report.
            let _ = start.run.snapshot.robot.finish(None, Some(&format!("{error:#}")));
            Err(error)
        }
    }
}

/// Returns the repertoire and the grasp pairs made while all digits had power.
fn intact_grasps(bench: &Bench) -> (&Repertoire, &GraspPairTable) {
    match &bench.intact_grasps {
        Some(intact) => (&intact.repertoire, &intact.plans),
        None => (&bench.repertoire, &bench.grasp_pairs),
    }
}

fn planned_pair(bench: &Bench, combination: usize) -> &GraspPair {
    &intact_grasps(bench).1.pairs[combination]
}

/// Draws a trial's errors with those of the first detection, the seed of its camera noise, and the generators of its
/// later detections.
pub fn draw_noise(bench: &Bench, combination: usize, trial: usize) -> Result<(TrialNoise, u64, DetectionNoise)> {
    let (world, seed) = (&bench.world, bench.seed);
    let scenario = &world.scenario;
    let mut rng = trial_rng(seed, combination, trial);
    let objects = world.models(&planned_pair(bench, combination).objects())?;
    let mut noise = TrialNoise::draw(&scenario.noise, objects.len(), &mut rng);
    let camera_noise = rand::RngExt::random(&mut rng);
    noise.shifts = draw_shifts(&scenario.layout, objects.len(), &mut rng);
    let noise = noise.with_effects(&scenario.effects, seed, combination, trial);
    let stream = Effect::Detector.draw_rng(seed, combination, trial);
    let sight = scenario.effects.detector.map(|eyes| DetectorModel::draw(eyes, &scenario.noise.perception, stream));
    let mut detections = DetectionNoise::new(rng, sight);
    let noise = detections.first_detection(&noise, &objects, &world.objects, &world.object_poses(&objects, &noise));
    Ok((noise, camera_noise, detections))
}

/// Returns perception with the backgrounds that the backend has shown.
fn with_backend_backgrounds(run: &Run, pipeline: &TouchPipeline) -> Result<TouchPipeline> {
    Ok(pipeline
        .with_backgrounds(backgrounds(run.snapshot.executor.motion().newest_images(), pipeline.backgrounds().len())?)?)
}
