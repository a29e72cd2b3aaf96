//! A trial whose policy moves the robot itself, step by step from the beginning.
//!
//! The policy names no phases: the referee reads them from the scene ([`Stages`]), and the policy sees nothing of that.
//! The trial ends when all objects have been held for long enough, when the policy says so, or at the time limit. The
//! body that carries out the commands limits them.

use std::time::{Duration, Instant};

use anyhow::Result;
use control::action::{Action, Stepper};
use control::inverse_kinematics::ArmKinematics;
use hand_model::robot::{Command, RobotBackend as _};
use nalgebra::Isometry3;
use scenarios::referee::FailureCause;
use scenarios::stages::Stages;
use scenarios::tries::TryRecord;
use serde_json::Value;
use world::attempt::Attempt;

use crate::trial::branch::{Play, TrialOutcome};
use crate::trial::run::Run;
use crate::trial::setup::Start;
use crate::trial::{Bench, Watcher};
use control::pad_images::{PadImages, capture_at};
use external_policy::Pace;
use external_policy::host::{Array, Host, HostError};
use external_policy::message::{self, Observed};

/// Time limit for requested images, s: after it they count as lost.
const LOST: f64 = 1.0;
/// Share of a trial's own lift from which an object counts as lifted.
const LIFTED: f64 = 0.5;

/// Images of a policy that wants some.
struct Camera {
    images: PadImages,
    /// Tick of a step in which images are requested: the last from which those of a simulated camera arrive within the
    /// step.
    at: usize,
    /// Time of the last request without images so far, s.
    asked: Option<f64>,
}

/// A trial in progress.
struct Driven<'a> {
    bench: &'a Bench,
    run: Run,
    stepper: Stepper,
    stages: Stages,
    kinematics: ArmKinematics,
    camera: Option<Camera>,
    seen: Vec<Isometry3<f64>>,
    /// Last requested command.
    last: Command,
}

/// End of a trial.
enum End {
    /// All objects have been held.
    Held,
    /// The policy reports that it has finished.
    Finished,
    /// The time limit was reached.
    Late,
    /// The policy has failed.
    Failed(String),
}

/// Plays a trial from rest with the answers of `host`. The first request is `reset`. Images have `side` pixels; without
/// `side` there are none.
pub fn drive(
    bench: &Bench,
    start: &Start,
    (host, reset, side): (&mut dyn Host, &Value, Option<usize>),
    with: &Play,
    watcher: &mut dyn Watcher,
) -> Result<TrialOutcome> {
    watcher.branch(with.id.condition)?;
    let scenario = &bench.world.scenario;
    let executor = &start.run.snapshot.executor;
    let stages =
        Stages::new(scenario.referee.palm_distance, LIFTED * bench.world.protocol().lift, scenario.protocol.hold_time);
    let cell = &bench.world.cell;
    let stepper = Stepper::new(cell, *executor.motion().posture(), cell.robot.hand.slack())?;
    let servos = cell.robot.hand.servo_goals(&[0.0; 5], 0.0, 0.0);
    let mut driven = Driven {
        bench,
        stepper,
        stages,
        kinematics: cell.kinematics(),
        last: Command { arm: *executor.motion().posture(), servos, capture: false },
        camera: side.map(|side| Camera::new(bench, start, side)).transpose()?,
        seen: executor.targets().iter().map(|target| target.percept.pose()).collect(),
        run: start.run.clone(),
    };
    let untouched = driven.camera.as_ref().map(Camera::array);
    let end = match host.ask(reset, untouched.as_slice()) {
        Ok(_) => driven.play(host, with, watcher)?,
        Err(error) => End::Failed(error.to_string()),
    };
    let run = &mut driven.run;
    let reason = match end {
        End::Held => String::new(),
        End::Finished => "the policy has finished".to_owned(),
        End::Late => "the time is up".to_owned(),
        End::Failed(why) => {
            run.referee.give_up(FailureCause::PolicyFailed);
            why
        }
    };
    if !reason.is_empty() {
        run.tell((Some(&reason), None), &[], with.id.condition, watcher)?;
    }
    let mut record = run.record(&start.objects, with.id)?;
    record.reason = reason;
    let why = "by the policy's steps".to_owned();
    let attempt = |object| Attempt { object, why: why.clone(), ..Attempt::default() };
    let verdicts = run.referee.tries().iter().enumerate();
    let tries = verdicts.map(|(n, verdict)| TryRecord::new(with.id, n, &attempt(verdict.object), Some(verdict)));
    let tries = tries.collect();
    watcher.outcome(&record)?;
    Ok(TrialOutcome { record, tries })
}

impl Camera {
    fn new(bench: &Bench, start: &Start, side: usize) -> Result<Self> {
        let mut images = PadImages::new(&bench.world.cell.robot.hand, side)?;
        let pipeline = start.pipeline.as_ref().unwrap_or(&bench.pipeline);
        images.show_backgrounds(&bench.world.cell.robot.hand, pipeline.backgrounds().to_vec());
        let delay = bench.world.scenario.effects.time.map_or(0.0, |time| time.frame);
        Ok(Self { images, at: capture_at(delay, start.run.snapshot.robot.tick_length()), asked: None })
    }

    /// Returns the newest image of every pad.
    fn array(&self) -> Array<'_> {
        let (pads, side) = (self.images.times().len(), self.images.side());
        Array { shape: vec![pads, side, side, 3], bytes: self.images.rgb() }
    }
}

impl Driven<'_> {
    fn play(&mut self, host: &mut dyn Host, with: &Play, watcher: &mut dyn Watcher) -> Result<End> {
        let (tick, limit) =
            (self.run.snapshot.executor.motion().tick_length(), self.bench.world.scenario.protocol.time_limit);
        self.observe()?;
        loop {
            let time = self.run.snapshot.robot.time();
            if time >= limit {
                return Ok(End::Late);
            }
            // A real body waits for the policy, up to its time limit for thinking.
            self.run.snapshot.robot.pause();
            let begun = Instant::now();
            let action = match self.ask(host, time, limit) {
                Ok(Some(action)) => action,
                Ok(None) => return Ok(End::Finished),
                Err(error) => return Ok(End::Failed(error.to_string())),
            };
            let goals = match self.stepper.step(&action, tick) {
                Ok(goals) => goals,
                Err(error) => return Ok(End::Failed(format!("the policy's action: {error}"))),
            };
            let thought = if with.pace == Pace::Wall { begun.elapsed() } else { Duration::ZERO };
            // Meanwhile the last command stays in force.
            let meanwhile = (thought.as_secs_f64() / tick) as usize;
            let mut commands = vec![self.last; meanwhile];
            commands.extend(goals.map(|(arm, servos)| Command { arm, servos, capture: false }));
            for (n, command) in commands.iter_mut().enumerate() {
                command.capture = self.captures((n + 1).saturating_sub(meanwhile));
                let sent =
                    self.run.carry_out(command, Some(&mut self.stages), (&[], Some(with.id.condition)), watcher)?;
                if let Some(sent) = sent {
                    self.stepper.sent(sent.arm);
                }
                self.last = *command;
                self.observe()?;
                if self.stages.is_done(self.run.snapshot.robot.time()) {
                    return Ok(End::Held);
                }
            }
        }
    }
    /// Asks the policy for its next action.
    fn ask(&mut self, host: &mut dyn Host, time: f64, limit: f64) -> Result<Option<Action>, HostError> {
        let executor = &self.run.snapshot.executor;
        let observed = Observed {
            time,
            time_left: limit - time,
            servos: executor.motion().servos(),
            arm: executor.motion().arm(),
            palm: self.kinematics.palm_pose(&executor.motion().arm().position),
            seen: self.seen.clone(),
        };
        let tactile = self.camera.as_ref().map(Camera::array);
        message::acted(host.ask(&message::act(&observed), tactile.as_slice())?)
    }

    /// Takes the newest measurements. If the robot cannot observe, the policy keeps the last ones.
    fn observe(&mut self) -> Result<()> {
        let Some(observation) = self.run.observe()? else { return Ok(()) };
        self.run.snapshot.executor.attend(&observation);
        if let Some(camera) = &mut self.camera
            && !observation.tactile.is_empty()
        {
            camera.asked = None;
            camera.images.show(&self.bench.world.cell.robot.hand, observation.tactile);
        }
        Ok(())
    }

    /// True if tick `n` of a step, counted from 1, requests images. No more are requested while some are on their way.
    fn captures(&mut self, n: usize) -> bool {
        let time = self.run.snapshot.robot.time();
        let Some(camera) = &mut self.camera else { return false };
        let captures = n == camera.at && camera.asked.is_none_or(|asked| time > asked + LOST);
        if captures {
            camera.asked = Some(time);
        }
        captures
    }
}
