//! A watcher that keeps a trial at the rate at which a learner acts: measurements, images and set-points of every step.

use anyhow::{Result, bail};
use control::action::{ActionLimits, TICKS_PER_STEP};
use control::inverse_kinematics::{ArmKinematics, Joints};
use control::pad_images::PadImages;
use external_policy::message::{self, TrialInfo};
use hand_model::robot::{ArmState, RobotCommand, ServoGoal, ServoState};
use hand_model::{ActuatorVector, DigitVector, Hand};
use nalgebra::Isometry3;
use rand::RngExt as _;
use robot_backends::TrialTask;
use scenarios::generator::trial_rng;
use scenarios::noise::TrialNoise;
use scenarios::record::{Condition, TrialId, TrialRecord};

use super::capabilities::PolicyCapabilities;
use super::setup::{InitialConditions, PreparedTrial, draw_noise};
use super::watcher::{TickView, Watcher};
use super::{Bench, EXTERNAL_POLICY_DOMAIN};

/// Interval between the images of the trial, s: half a tick less than a step, because times are sums of ticks.
const IMAGE_PERIOD: f64 = (TICKS_PER_STEP as f64 - 0.5) / 120.0;

/// Set-points of one tick.
#[derive(Debug, Clone, Copy)]
pub struct SetPoints {
    /// Joints of the arm, rad.
    pub arm: Joints,
    /// `world_from_palm` at these joints.
    pub palm: Isometry3<f64>,
    /// Tensions of the cables at the spools, N.
    pub tensions: DigitVector,
    /// Angle of the opposition joint, rad.
    pub opposition: f64,
}

/// One step: the measurements at its beginning, and the set-points of its ticks.
#[derive(Debug, Clone)]
pub struct TrialStep {
    /// Time since the robot was started, s.
    pub time: f64,
    pub servos: ActuatorVector<ServoState>,
    pub arm: ArmState,
    /// `world_from_palm` from the arm's encoders.
    pub palm: Isometry3<f64>,
    /// Set-points of the ticks; the last step of a trial may have fewer than [`TICKS_PER_STEP`].
    pub set_points: Vec<SetPoints>,
}

/// A trial as a learner sees it, with the objects in the combination's order.
pub struct RecordedSteps {
    /// Beginning of the trial.
    pub start: LearnerStart,
    pub steps: Vec<TrialStep>,
    /// Images at the beginning of each step: steps x pads x rows x columns x RGB.
    pub images: Vec<u8>,
}

/// Beginning of a trial as a learner sees it.
pub struct LearnerStart {
    /// The question that an acting policy is asked at the beginning of this trial.
    pub reset: serde_json::Value,
    /// `world_from_object` of each object, as detected at the start.
    pub detected: Vec<Isometry3<f64>>,
    /// Images of the untouched pads.
    pub pictures: PadImages,
    /// True if the trial takes the objects in the reverse of the combination's order.
    pub reversed: bool,
}

/// Reads commands as set-points.
pub struct SetPointReader<'a> {
    hand: &'a Hand,
    kinematics: ArmKinematics,
}

/// Keeps the steps of a trial.
struct StepRecorder<'a> {
    reader: SetPointReader<'a>,
    pictures: PadImages,
    ticks: usize,
    steps: Vec<TrialStep>,
    images: Vec<u8>,
}

impl Bench {
    /// Runs a trial of the policy `touch` and keeps its steps, with images of `side` x `side` pixels. The trial is the
    /// same as without images in between.
    pub fn record_steps(&self, combination: usize, trial: usize, side: usize) -> Result<(RecordedSteps, TrialRecord)> {
        let condition = Condition::Touch;
        let Some(means) = PolicyCapabilities::for_condition(condition) else {
            bail!("condition {condition}: found one that does not decide, expected one that does")
        };
        let (setup, detections) = InitialConditions::noisy(self, combination, trial)?;
        let mut start = setup.reordered_for(self, means)?.begin(self, None, true)?;
        start.run.snapshot.executor.request_images_every(IMAGE_PERIOD);
        let begun = self.learner_start(&start, (combination, trial), side)?;
        let (reader, pictures) = (self.set_point_reader(), begun.pictures.clone());
        let mut recorder = StepRecorder { reader, pictures, ticks: 0, steps: Vec::new(), images: Vec::new() };
        let id = TrialId { combination, trial, condition };
        let outcome = self.run_touch(&start, self.branch_settings(id, detections), means, &mut recorder)?;
        let StepRecorder { steps, images, .. } = recorder;
        Ok((RecordedSteps { start: begun, steps, images }, outcome.record))
    }

    /// Returns the beginning of the trial of a recorded session, without its own detections.
    pub fn session_start(&self, task: &TrialTask, side: usize) -> Result<LearnerStart> {
        let (mut noise, mut camera_noise, _) = draw_noise(self, task.combination, task.trial)?;
        if task.condition == Condition::Ideal || task.is_real() {
            (noise, camera_noise) = (TrialNoise::none(), if task.is_real() { camera_noise } else { 0 });
        }
        let setup = InitialConditions::planned(self, task.combination, noise, camera_noise);
        let setup = match PolicyCapabilities::for_condition(task.condition) {
            Some(means) if means.may_skip_planned_grasp() => setup.reordered_for(self, means)?,
            _ => setup,
        };
        self.learner_start(&setup.begin(self, None, false)?, (task.combination, task.trial), side)
    }

    /// Returns a reader of the commands of this bench's robot.
    pub fn set_point_reader(&self) -> SetPointReader<'_> {
        SetPointReader { hand: &self.world.cell.robot.hand, kinematics: self.world.cell.kinematics() }
    }

    fn learner_start(
        &self,
        start: &PreparedTrial,
        (combination, trial): (usize, usize),
        side: usize,
    ) -> Result<LearnerStart> {
        let executor = &start.run.snapshot.executor;
        let mut objects: Vec<_> = start.objects.iter().map(|object| &**object).collect();
        let mut detections: Vec<_> = executor.targets().iter().map(|target| target.detected).collect();
        let reversed = start.reordered.is_some();
        if reversed {
            objects.reverse();
            detections.reverse();
        }
        let limits = ActionLimits::for_workcell(&self.world.cell);
        let reset = message::reset_question(&TrialInfo {
            combination,
            trial,
            seed: trial_rng(self.seed ^ EXTERNAL_POLICY_DOMAIN, combination, trial).random(),
            objects,
            yaws: detections.iter().map(|object| object.yaw).collect(),
            limits: &limits,
        });
        let hand = &self.world.cell.robot.hand;
        let mut pictures = PadImages::new(hand, side)?;
        let pipeline = start.pipeline.as_ref().unwrap_or(&self.pipeline);
        pictures.show_backgrounds(hand, pipeline.backgrounds().to_vec());
        let detected = detections.iter().map(|object| object.pose()).collect();
        Ok(LearnerStart { reset, detected, pictures, reversed })
    }
}

impl SetPointReader<'_> {
    /// Returns the pose of the palm at these joints (rad), `world_from_palm`.
    pub fn palm_pose(&self, joints: &Joints) -> Isometry3<f64> {
        self.kinematics.palm_pose(joints)
    }

    /// Reads a command.
    ///
    /// # Errors
    /// If a cable's servo is commanded by its angle: the command has no tension.
    pub fn set_points(&self, sent: &RobotCommand) -> Result<SetPoints> {
        let (hand, mut opposition) = (self.hand, 0.0);
        let mut tensions: DigitVector = hand.cables.iter().map(|_| 0.0).collect();
        for (n, goal) in sent.servos.iter().enumerate() {
            match (goal, hand.cables.get(n)) {
                (ServoGoal::Current(current), Some(cable)) => {
                    tensions[n] = current * hand.servos[n].torque_constant / cable.spool_radius;
                }
                (ServoGoal::Position { angle, .. }, None) => opposition = angle / hand.servos[n].gear_ratio_opposition,
                _ => bail!("servo {n}: found {goal:?}, expected a current for a cable and an angle for the opposition"),
            }
        }
        Ok(SetPoints { arm: sent.arm, palm: self.palm_pose(&sent.arm), tensions, opposition })
    }
}

impl Watcher for StepRecorder<'_> {
    fn is_active(&self) -> bool {
        true
    }

    fn on_tick(&mut self, moment: &TickView) -> Result<()> {
        // Without a command no tick has passed.
        let Some(sent) = moment.sent else { return Ok(()) };
        let motion = moment.executor.motion();
        if self.ticks.is_multiple_of(TICKS_PER_STEP) {
            self.pictures.show(self.reader.hand, motion.newest_images().to_vec());
            self.images.extend_from_slice(self.pictures.rgb());
            let servos = motion.servos().iter().copied().collect();
            self.steps.push(TrialStep {
                time: moment.time - motion.tick_length(),
                servos,
                arm: *motion.arm(),
                palm: self.reader.palm_pose(&motion.arm().position),
                set_points: Vec::with_capacity(TICKS_PER_STEP),
            });
        }
        let points = self.reader.set_points(sent)?;
        if let Some(step) = self.steps.last_mut() {
            step.set_points.push(points);
        }
        self.ticks += 1;
        Ok(())
    }

    fn on_branch(&mut self, _: Condition) -> Result<()> {
        Ok(())
    }

    fn on_outcome(&mut self, _: &TrialRecord) -> Result<()> {
        Ok(())
    }
}
