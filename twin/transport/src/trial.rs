//! One transport under one policy: as many trips to the goal as needed.

use std::sync::Arc;

use anyhow::Result;
use control::detection::{DetectionError, ObjectDetector, PoseDetection};
use control::executor::{Executor, Skill};
use control::motion::MotionProtocol;
use control::policy::PolicyStep;
use control::policy::pick_sequence::plan::PickSkill;
use control::policy::pick_sequence::{PickMode, PickObject, PickSequence, PickTask};
use control::sensing::TouchPerception;
use grasp_verification::rollout::RolloutSnapshot;
use grasp_verification::simulated_world::SimulatedWorld;
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use scenarios::generator::trial_rng;
use scenarios::noise::{NoiseLevels, TrialNoise};
use scenarios::transport::{PushStage, TransportBall, TransportTask};
use schemars::JsonSchema;
use serde::Serialize;
use sim::SimulatedRobot;
use sim::robot::GroundTruth;
use sim::tactile::TactileBoard;
use tactile_perception::TouchPipeline;
use world::Sensing;

use super::site::{build_scene, is_in_hand, run_until_decision};

/// Outcome of a transport.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct TransportRecord {
    /// Policy of the transport.
    #[schemars(with = "String")]
    pub policy: PickMode,
    /// Number of the transport.
    pub trial: usize,
    /// Number of balls to carry.
    pub balls: usize,
    /// Number of objects truly in the hand at the end of the hold over the goal, per trip.
    pub carried: Vec<usize>,
    /// Names of all objects carried.
    pub names: Vec<String>,
    /// Total volume of the objects carried, cm3.
    pub volume_cm3: f64,
    /// Number of picks attempted.
    pub picks: usize,
    /// Simulated time up to the last release, s.
    pub seconds: f64,
    /// Event log: decisions, tactile findings and disturbances.
    pub events: Vec<String>,
}

/// Data shared by all transports of a scenario.
pub struct TransportSite {
    /// Robot and protocol.
    pub world: SimulatedWorld,
    /// Objects to carry, goal, noise and protocol.
    pub transport: TransportTask,
    /// Skills (picks verified by rollouts), each marked with the number of its ball size.
    pub skills: Vec<PickSkill>,
    /// For each ball, indices of the skills that suit it.
    pub suitable_skills: Vec<Vec<usize>>,
    /// Tactile cameras of the hand unit.
    pub cameras: TactileBoard,
    /// Tactile perception pipeline.
    pub pipeline: TouchPipeline,
    /// Seed of all random draws.
    pub seed: u64,
}

/// Callback for every tick of a transport. The text, if any, is the latest decision or event.
pub type TickCallback<'a> = &'a mut dyn FnMut(&GroundTruth, &Executor, Option<&str>) -> Result<()>;

/// A transport in progress.
struct Progress<'a> {
    site: &'a TransportSite,
    branch: RolloutSnapshot,
    /// Balls truly in the hand at the newest tick of a hold.
    held: Vec<usize>,
    /// Simulated time at which the push began, s; none before it.
    push_start: Option<f64>,
    /// Text for the callback at the next tick.
    note: Option<String>,
    record: TransportRecord,
}

impl TransportSite {
    /// Returns the motion protocol (distances and times) with the lift height and hold time of this transport.
    pub fn protocol(&self) -> MotionProtocol {
        let times = &self.transport.protocol;
        MotionProtocol { lift: times.lift_height, hold_time: times.hold_time, ..self.world.protocol() }
    }

    /// Runs one transport. Its errors depend on seed and trial alone, so that every policy has the same arm.
    pub fn run(&self, trial: usize, policy: PickMode, witness: TickCallback) -> Result<TransportRecord> {
        let mut rng = trial_rng(self.seed, 0, trial);
        let noise = TrialNoise::draw(&self.transport.noise, 2, &mut rng);
        let board = self.cameras.with_noise(rand::RngExt::random(&mut rng));
        let balls: Vec<_> = self.transport.ball.iter().map(|ball| (Arc::new(ball.model()), ball.pose())).collect();
        let items = self.known_balls();
        let goal = self.transport.goal;
        let task = PickTask {
            cell: &self.world.cell,
            skills: &self.skills,
            items: &items,
            goal: [goal.x, goal.y],
            max_picks: self.transport.protocol.tries * balls.len(),
        };
        let mut sequence = PickSequence::new(task, policy, TouchPerception::new(&self.pipeline, Sensing::Full)?);
        let mut progress = Progress {
            site: self,
            branch: build_scene(&self.world, self.protocol(), &balls, &noise, board)?,
            held: Vec::new(),
            push_start: None,
            note: None,
            record: TransportRecord {
                policy,
                trial,
                balls: balls.len(),
                carried: Vec::new(),
                names: Vec::new(),
                volume_cm3: 0.0,
                picks: 0,
                seconds: 0.0,
                events: Vec::new(),
            },
        };
        loop {
            let RolloutSnapshot { robot, executor } = &mut progress.branch;
            let mut detector = SimulatedDetector { robot, noise: &self.transport.noise, rng: &mut rng };
            let step = sequence.decide(executor, &mut detector)?;
            progress.log_events(sequence.take_reasons());
            progress.record.picks = sequence.picks();
            if step != PolicyStep::Continue {
                return Ok(progress.record);
            }
            if progress.branch.executor.phase().has_begun_carry() {
                progress.run_delivery(witness)?;
            } else {
                progress.run_to_decision(witness)?;
                sequence.perceive(&mut progress.branch.executor)?;
                progress.log_events(sequence.take_reasons());
            }
        }
    }

    /// Returns the balls as given to the policy: name, volume, suitable skills.
    fn known_balls(&self) -> Vec<PickObject> {
        let balls = self.transport.ball.iter().zip(&self.suitable_skills);
        let item = |(ball, pickups): (&TransportBall, &Vec<usize>)| PickObject {
            name: ball.name.clone(),
            volume: ball.volume(),
            skills: pickups.clone(),
        };
        balls.map(item).collect()
    }
}

/// Object detector with noise: every detection of a ball draws a new error.
struct SimulatedDetector<'a> {
    robot: &'a SimulatedRobot,
    noise: &'a NoiseLevels,
    rng: &'a mut ChaCha8Rng,
}

impl ObjectDetector for SimulatedDetector<'_> {
    fn detect(&mut self, object: usize) -> Result<Option<PoseDetection>, DetectionError> {
        let noise = TrialNoise::draw(self.noise, 2, self.rng).objects[0];
        Ok(Some(noise.perceived_pose(&self.robot.truth().objects[object]).into()))
    }
}

impl Progress<'_> {
    fn log_events(&mut self, texts: Vec<String>) {
        for text in texts {
            self.record.events.push(text.clone());
            self.note = Some(match self.note.take() {
                Some(before) => format!("{before}; {text}"),
                None => text,
            });
        }
    }

    /// Runs the motion to the goal and records the balls that arrive there in the hand.
    fn run_delivery(&mut self, witness: TickCallback) -> Result<()> {
        self.held.clear();
        self.run_to_decision(witness)?;
        let balls = &self.site.transport.ball;
        let carried: Vec<&TransportBall> = self.held.iter().map(|ball| &balls[*ball]).collect();
        self.record.volume_cm3 += carried.iter().map(|ball| ball.volume() * 1e6).sum::<f64>();
        let names: Vec<String> = carried.iter().map(|ball| ball.name.clone()).collect();
        self.record.carried.push(names.len());
        self.record.seconds = self.branch.robot.time();
        let what = if names.is_empty() { "nothing".to_owned() } else { names.join(", ") };
        let text = format!("trip {}: {what} in the hand over the goal", self.record.carried.len());
        self.record.names.extend(names);
        self.log_events(vec![text]);
        Ok(())
    }

    /// Runs to the next decision. Applies the push, updates the balls held over the goal and calls `witness` at every
    /// tick.
    fn run_to_decision(&mut self, witness: TickCallback) -> Result<()> {
        let Self { site, branch, push_start: pushed, held, note, record, .. } = self;
        let count = site.transport.ball.len();
        let first = record.picks == 1;
        run_until_decision(branch, |robot, executor| {
            if let Some(push) = site.transport.push.as_ref().filter(|_| first) {
                let skill = match push.stage {
                    PushStage::Approach => Skill::Approach,
                    PushStage::Close => Skill::Grasp,
                    PushStage::Lift => Skill::Lift,
                };
                let due = executor.phase().skill == skill && executor.motion().progress() >= push.at;
                if due && pushed.is_none() {
                    *pushed = Some(robot.time());
                    let text = format!("push of {:.2} N on {}", Vector3::from(push.force).norm(), push.ball);
                    record.events.push(text.clone());
                    *note = Some(text);
                }
                if pushed.is_some_and(|since| robot.time() - since < push.duration) {
                    let ball = site.transport.ball.iter().position(|ball| ball.name == push.ball);
                    robot.apply_force(ball, Vector3::from(push.force));
                }
            }
            let truth = robot.truth();
            if executor.phase().skill == Skill::Hold {
                *held = (0..count).filter(|ball| is_in_hand(&truth, *ball)).collect();
            }
            witness(&truth, executor, note.take().as_deref())?;
            Ok(true)
        })?;
        Ok(())
    }
}
