//! A trial whose policy moves the robot itself, step by step from the start.
//!
//! The policy does not report phases: the referee reads them from the scene ([`PhaseTracker`]), hidden from the policy.
//! The trial ends when all objects have been held for long enough, when the policy reports its end, or at the time
//! limit. The backend that carries out the commands limits them.

use std::time::{Duration, Instant};

use anyhow::Result;
use control::action::{Action, Stepper};
use control::inverse_kinematics::ArmKinematics;
use hand_model::robot::{RobotBackend as _, RobotCommand};
use nalgebra::Isometry3;
use scenarios::phase_tracker::PhaseTracker;
use scenarios::referee::FailureCause;
use scenarios::tries::TryRecord;
use serde_json::Value;
use world::attempt::Attempt;

use crate::trial::branch::{BranchSettings, TrialOutcome};
use crate::trial::run::Run;
use crate::trial::setup::PreparedTrial;
use crate::trial::{Bench, Watcher};
use control::pad_images::{PadImages, capture_tick};
use external_policy::SimulatedTimePassage;
use external_policy::message::{self, PolicyObservation};
use external_policy::server::{PolicyServer, PolicyServerError, QuestionArray};

/// Time limit for requested images, s; later ones count as lost.
const IMAGE_TIMEOUT: f64 = 1.0;
/// Share of a trial's own lift from which an object counts as lifted.
const LIFTED_SHARE: f64 = 0.5;

/// Images of a policy that requests them.
struct PolicyCamera {
    images: PadImages,
    /// Tick of a step in which images are requested: the last from which those of a simulated camera arrive within the
    /// step.
    request_tick: usize,
    /// Time of the last request without images so far, s.
    requested_since: Option<f64>,
}

/// A trial in progress.
struct ExternalTrial<'a> {
    bench: &'a Bench,
    run: Run,
    stepper: Stepper,
    stages: PhaseTracker,
    kinematics: ArmKinematics,
    camera: Option<PolicyCamera>,
    detected_poses: Vec<Isometry3<f64>>,
    /// Last requested command.
    last_command: RobotCommand,
}

/// End of a trial.
enum TrialEnd {
    /// All objects have been held.
    Held,
    /// The policy reports that it has finished.
    Finished,
    /// The time limit was reached.
    TimedOut,
    /// The policy has failed.
    Failed(String),
}

/// Runs a trial from rest with the answers of `host`. The first request is `reset`. Images have `side` pixels; without
/// `side` there are none.
pub fn run_external_trial(
    bench: &Bench,
    start: &PreparedTrial,
    (host, reset, side): (&mut dyn PolicyServer, &Value, Option<usize>),
    with: &BranchSettings,
    watcher: &mut dyn Watcher,
) -> Result<TrialOutcome> {
    watcher.on_branch(with.id.condition)?;
    let scenario = &bench.world.scenario;
    let executor = &start.run.snapshot.executor;
    let stages = PhaseTracker::new(
        scenario.referee.palm_distance,
        LIFTED_SHARE * bench.world.protocol().lift,
        scenario.protocol.hold_time,
    );
    let cell = &bench.world.cell;
    let stepper = Stepper::new(cell, *executor.motion().posture(), cell.robot.hand.slack_tensions())?;
    let servos = cell.robot.hand.servo_goals(&[0.0; 5], 0.0, 0.0);
    let mut driven = ExternalTrial {
        bench,
        stepper,
        stages,
        kinematics: cell.kinematics(),
        last_command: RobotCommand { arm: *executor.motion().posture(), servos, capture: false },
        camera: side.map(|side| PolicyCamera::new(bench, start, side)).transpose()?,
        detected_poses: executor.targets().iter().map(|target| target.detected.pose()).collect(),
        run: start.run.clone(),
    };
    let untouched = driven.camera.as_ref().map(PolicyCamera::array);
    let end = match host.ask(reset, untouched.as_slice()) {
        Ok(_) => driven.run(host, with, watcher)?,
        Err(error) => TrialEnd::Failed(error.to_string()),
    };
    let run = &mut driven.run;
    let reason = match end {
        TrialEnd::Held => String::new(),
        TrialEnd::Finished => "the policy has finished".to_owned(),
        TrialEnd::TimedOut => "the time limit was reached".to_owned(),
        TrialEnd::Failed(why) => {
            run.referee.give_up(FailureCause::PolicyFailed);
            why
        }
    };
    if !reason.is_empty() {
        run.notify_watcher((Some(&reason), None), &[], with.id.condition, watcher)?;
    }
    let mut record = run.record(&start.objects, with.id)?;
    record.reason = reason;
    let why = "by the policy's steps".to_owned();
    let attempt = |object| Attempt { object, why: why.clone(), ..Attempt::default() };
    let verdicts = run.referee.tries().iter().enumerate();
    let tries = verdicts.map(|(n, verdict)| TryRecord::new(with.id, n, &attempt(verdict.object), Some(verdict)));
    let tries = tries.collect();
    watcher.on_outcome(&record)?;
    Ok(TrialOutcome { record, tries })
}

impl PolicyCamera {
    fn new(bench: &Bench, start: &PreparedTrial, side: usize) -> Result<Self> {
        let mut images = PadImages::new(&bench.world.cell.robot.hand, side)?;
        let pipeline = start.pipeline.as_ref().unwrap_or(&bench.pipeline);
        images.show_backgrounds(&bench.world.cell.robot.hand, pipeline.backgrounds().to_vec());
        let delay = bench.world.scenario.effects.time.map_or(0.0, |time| time.frame);
        Ok(Self {
            images,
            request_tick: capture_tick(delay, start.run.snapshot.robot.tick_length()),
            requested_since: None,
        })
    }

    /// Returns the newest image of every pad.
    fn array(&self) -> QuestionArray<'_> {
        let (pads, side) = (self.images.times().len(), self.images.side());
        QuestionArray { shape: vec![pads, side, side, 3], bytes: self.images.rgb() }
    }
}

impl ExternalTrial<'_> {
    fn run(
        &mut self,
        host: &mut dyn PolicyServer,
        with: &BranchSettings,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialEnd> {
        let (tick, limit) =
            (self.run.snapshot.executor.motion().tick_length(), self.bench.world.scenario.protocol.time_limit);
        self.observe()?;
        loop {
            let time = self.run.snapshot.robot.time();
            if time >= limit {
                return Ok(TrialEnd::TimedOut);
            }
            // A real backend waits for the policy, up to the time limit of an answer.
            self.run.snapshot.robot.pause();
            let begun = Instant::now();
            let action = match self.request_action(host, time, limit) {
                Ok(Some(action)) => action,
                Ok(None) => return Ok(TrialEnd::Finished),
                Err(error) => return Ok(TrialEnd::Failed(error.to_string())),
            };
            let goals = match self.stepper.step(&action, tick) {
                Ok(goals) => goals,
                Err(error) => return Ok(TrialEnd::Failed(format!("the policy's action failed: {error}"))),
            };
            let thought = if with.pace == SimulatedTimePassage::Wall { begun.elapsed() } else { Duration::ZERO };
            // The last command stays in force meanwhile.
            let meanwhile = (thought.as_secs_f64() / tick) as usize;
            let mut commands = vec![self.last_command; meanwhile];
            commands.extend(goals.map(|(arm, servos)| RobotCommand { arm, servos, capture: false }));
            for (n, command) in commands.iter_mut().enumerate() {
                command.capture = self.requests_images((n + 1).saturating_sub(meanwhile));
                let sent =
                    self.run.carry_out(command, Some(&mut self.stages), (&[], Some(with.id.condition)), watcher)?;
                if let Some(sent) = sent {
                    self.stepper.adopt_sent(sent.arm);
                }
                self.last_command = *command;
                self.observe()?;
                if self.stages.is_done(self.run.snapshot.robot.time()) {
                    return Ok(TrialEnd::Held);
                }
            }
        }
    }
    /// Asks the policy for its next action.
    fn request_action(
        &mut self,
        host: &mut dyn PolicyServer,
        time: f64,
        limit: f64,
    ) -> Result<Option<Action>, PolicyServerError> {
        let executor = &self.run.snapshot.executor;
        let observed = PolicyObservation {
            time,
            time_left: limit - time,
            servos: executor.motion().servos(),
            arm: executor.motion().arm(),
            palm: self.kinematics.palm_pose(&executor.motion().arm().position),
            detected_poses: self.detected_poses.clone(),
        };
        let tactile = self.camera.as_ref().map(PolicyCamera::array);
        message::parse_action(host.ask(&message::act_question(&observed), tactile.as_slice())?)
    }

    /// Takes the newest measurements. If the robot cannot observe, the policy keeps the last ones.
    fn observe(&mut self) -> Result<()> {
        let Some(observation) = self.run.observe()? else { return Ok(()) };
        self.run.snapshot.executor.record_measurements(&observation);
        if let Some(camera) = &mut self.camera
            && !observation.tactile.is_empty()
        {
            camera.requested_since = None;
            camera.images.show(&self.bench.world.cell.robot.hand, observation.tactile);
        }
        Ok(())
    }

    /// True if tick `n` of a step, counted from 1, requests images. No more are requested while some are on their way.
    fn requests_images(&mut self, n: usize) -> bool {
        let time = self.run.snapshot.robot.time();
        let Some(camera) = &mut self.camera else { return false };
        let captures =
            n == camera.request_tick && camera.requested_since.is_none_or(|asked| time > asked + IMAGE_TIMEOUT);
        if captures {
            camera.requested_since = Some(time);
        }
        captures
    }
}
