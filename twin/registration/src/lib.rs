//! Registration of the arm's base to the table: the hand touches balls on known marks, and [`control::registration`]
//! fits the base pose to them.
//!
//! A pad that comes down on the flat table measures only the table's height under it. A ball gives all three
//! coordinates of its centre, by the same guarded motion and the same registration of touches with which the policy
//! `touch` palpates an object before grasping it.

mod file;

use anyhow::{Context as _, Result, bail};
use control::detection::DetectedObject;
use control::executor::{Executor, GraspTarget, Phase, Skill};
use control::guarded::GuardedMotion;
use control::outage::Outage;
use control::palpation::estimate_touched_pose;
use control::perception::KnownObject;
use control::registration::{Registration, TouchedPoint, register};
use control::sensing::TouchPerception;
use dexterous_grasping::{Grasp, Repertoire, digit_sets};
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::robot::RobotBackend as _;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use scenarios::noise::TrialNoise;
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SimulatedRobot};
use tactile_perception::{PosePrior, TouchPipeline};
use world::Sensing;

use robot_backends::{TrialBackend, TrialStopped};
use tactile_perception::backgrounds;

pub use file::RegistrationFile;
pub use robot_backends::registration_plan::{RegistrationPlan, hidden_mount};

/// Standard deviation of the rotation of the ball in the hand, rad: all of its rotations are equivalent.
const BALL_ROTATION_SIGMA: f64 = 0.08;
/// Time limit for the images of the untouched pads, s.
const IMAGE_TIMEOUT: f64 = 5.0;
/// Number of attempts to touch a ball that is not felt.
const MAX_TRIES: usize = 3;
/// Time limit of each part of the motion, s.
const MOTION_TIMEOUT: f64 = 60.0;

/// Progress of the registration, for display.
pub enum RegistrationStep<'a> {
    /// About to touch the ball on this mark (from 0) for this time (from 0).
    Touching(usize, usize),
    /// The ball was felt at this offset from its expected position, world, m.
    Felt(&'a Vector3<f64>),
    /// Nothing was felt that can be the ball.
    NothingFelt,
}

/// A hand that moves from ball to ball.
pub struct Registrar<'a> {
    world: &'a SimulatedWorld,
    plan: &'a RegistrationPlan,
    ball: KnownObject,
    radius: f64,
    grasp: Grasp,
}

impl<'a> Registrar<'a> {
    /// Creates a registrar with the ball of `plan`. The fingers that do not touch take the posture of a grasp of
    /// `repertoire`.
    pub fn new(world: &'a SimulatedWorld, plan: &'a RegistrationPlan, repertoire: &Repertoire) -> Result<Self> {
        let model = world.object(&plan.object)?;
        let world::geometry::ObjectShape::Sphere { radius } = model.shape else {
            bail!("registration.toml: object: found {}, expected a ball", plan.object);
        };
        let first = &digit_sets(&world.cell.robot.hand, 2)[0];
        let grasp = repertoire.for_digits(&plan.object, first).next();
        let grasp = grasp.with_context(|| format!("no grasp of {} is known", plan.object))?.clone();
        Ok(Self { world, plan, ball: KnownObject::new(model), radius, grasp })
    }

    /// Returns the centre of the ball on a mark, world, m.
    pub fn ball_center(&self, mark: usize) -> Point3<f64> {
        let [x, y] = self.plan.marks[mark];
        Point3::new(x, y, self.radius)
    }

    /// Returns the placements of the balls on all marks.
    pub fn placements(&self) -> Vec<ObjectPlacement> {
        let placement = |mark: usize| ObjectPlacement {
            model: self.ball.model.clone(),
            pose: Isometry3::from_parts(Translation3::from(self.ball_center(mark).coords), self.ball.model.rest),
        };
        (0..self.plan.marks.len()).map(placement).collect()
    }

    /// Creates the simulated robot in front of fixed balls on all marks, with its base at `world_from_base`.
    pub fn simulated_robot(&self, world_from_base: &Isometry3<f64>, board: TactileBoard) -> SimulatedRobot {
        let setup = self.world.bare_scene(self.world.cell.ready_posture, &TrialNoise::none());
        let setup = sim::SceneSetup { world_from_base: *world_from_base, objects: self.placements(), ..setup };
        let cell = &self.world.cell;
        let mut robot = SimulatedRobot::new(&cell.robot, &setup, board);
        (0..self.plan.marks.len()).for_each(|object| robot.fix_object(object));
        robot
    }

    /// Creates the executor about to touch the first ball, with the arm in its ready posture.
    fn executor(&self, tick: f64) -> Result<Executor> {
        let cell = &self.world.cell;
        let start = GraspTarget { grasp: self.grasp.clone(), detected: self.detected_ball(&self.ball_center(0), 0.0) };
        let (servo, protocol) = (cell.arm_servo(cell.ready_posture)?, self.world.protocol());
        Ok(Executor::new(cell.robot.hand.clone(), servo, protocol, vec![start], tick)?)
    }

    /// Returns the detected pose of a ball at `middle`, to be touched with the hand at yaw `heading` (rad).
    fn detected_ball(&self, middle: &Point3<f64>, heading: f64) -> DetectedObject {
        let ball = DetectedObject::from_ball_pose(&Isometry3::from_parts(
            Translation3::from(middle.coords),
            UnitQuaternion::identity(),
        ));
        DetectedObject { yaw: heading - self.grasp.yaw, ..ball }
    }

    /// Plans all touches with the base at its nominal pose. Returns the duration (s) of each feasible touch, by mark
    /// and by heading.
    pub fn dry_run(&self) -> Result<Vec<Vec<Option<f64>>>> {
        let mut executor = self.executor(1.0 / 120.0)?;
        let mut time = |mark: usize, heading: f64| {
            executor.update_detection(0, self.detected_ball(&self.ball_center(mark), heading));
            let touching = executor.feasible_palpations(0, &self.ball.model.shape).next();
            touching.map(|touching| touching.approach.duration() + touching.guarded_motion.duration())
        };
        let headings = &self.plan.headings;
        Ok((0..self.plan.marks.len())
            .map(|mark| headings.iter().map(|heading| time(mark, *heading)).collect())
            .collect())
    }

    /// Touches every ball once with each heading, and fits the base pose to them. At the end the hand is back at its
    /// start. After a stop it stays where it is.
    pub fn run(
        &self,
        body: &mut dyn TrialBackend,
        pipeline: &TouchPipeline,
        tell: &mut dyn FnMut(RegistrationStep),
    ) -> Result<(Registration, Vec<TouchedPoint>)> {
        let mut executor = self.executor(body.tick_length())?;
        executor.request_images_every(IMAGE_TIMEOUT);
        let pipeline = self.with_untouched_images(body, &mut executor, pipeline)?;
        let senses = TouchPerception::new(&pipeline, Sensing::Full)?;
        // Pose of the table in the world of the arm's nominal base.
        let mut cell_from_world = Isometry3::identity();
        let mut points = Vec::new();
        for (round, heading) in self.plan.headings.iter().enumerate() {
            for mark in 0..self.plan.marks.len() {
                let expected = cell_from_world * self.ball_center(mark);
                let mut felt = None;
                // Late images on a busy computer can miss a touch.
                for _ in 0..MAX_TRIES {
                    tell(RegistrationStep::Touching(mark, round));
                    felt = self.touch_ball(body, &mut executor, &senses, &expected, *heading, round)?;
                    if felt.is_some() {
                        break;
                    }
                    tell(RegistrationStep::NothingFelt);
                }
                let found = felt.with_context(|| {
                    format!(
                        "mark {}: found no touch of a {} within {:.0} mm, expected it on its mark",
                        mark + 1,
                        self.plan.object,
                        1e3 * self.search_distance(round)
                    )
                })?;
                let base_from_world = self.world.cell.world_from_base.inverse();
                let turn = base_from_world.rotation.to_rotation_matrix().into_inner();
                tell(RegistrationStep::Felt(&(found.0 - expected)));
                points.push(TouchedPoint {
                    known: self.ball_center(mark),
                    felt: base_from_world * found.0,
                    covariance: turn * found.1 * turn.transpose(),
                });
            }
            // The touches so far predict the positions of the balls in the next round.
            let fitted = register(&points, f64::INFINITY)?;
            cell_from_world = self.world.cell.world_from_base * fitted.world_from_base.inverse();
        }
        Ok((register(&points, self.plan.max_residual)?, points))
    }

    /// Returns the prior standard deviation of a ball's position in this round, m.
    fn position_sigma(&self, round: usize) -> f64 {
        if round == 0 { self.plan.expected } else { 0.5 * self.plan.expected }
    }

    fn search_distance(&self, round: usize) -> f64 {
        4.0 * self.position_sigma(round)
    }

    /// Returns perception with reference images of the pads before they touch anything.
    fn with_untouched_images(
        &self,
        body: &mut dyn TrialBackend,
        executor: &mut Executor,
        pipeline: &TouchPipeline,
    ) -> Result<TouchPipeline> {
        let mut left = (IMAGE_TIMEOUT / body.tick_length()) as u64;
        let mut outage = Outage::default();
        while executor.motion().newest_images().len() < executor.motion().hand().cameras.len() {
            tick(body, executor, &mut outage)?;
            left = left.saturating_sub(1);
            if left == 0 {
                break;
            }
        }
        Ok(pipeline.with_backgrounds(backgrounds(executor.motion().newest_images(), pipeline.backgrounds().len())?)?)
    }

    /// Touches the ball expected at `expected`. Returns its position in the world of the arm's nominal base, m, with
    /// covariance, m2; none if it was not felt.
    fn touch_ball(
        &self,
        body: &mut dyn TrialBackend,
        executor: &mut Executor,
        senses: &TouchPerception,
        expected: &Point3<f64>,
        heading: f64,
        round: usize,
    ) -> Result<Option<(Point3<f64>, nalgebra::Matrix3<f64>)>> {
        let detected = self.detected_ball(expected, heading);
        executor.update_detection(0, detected);
        let touching = executor.feasible_palpations(0, &self.ball.model.shape).next();
        let touching = touching.with_context(|| format!("the arm does not reach a ball at {expected:.3}"))?;
        let hand = executor.motion().hand().clone();
        let guarded = GuardedMotion::new(touching.guarded_motion, &hand, &digit_sets(&hand, 2)[1], |pad| {
            senses.uses_pad(&hand, pad)
        });
        executor.palpate(0, touching.approach, guarded);
        run_phase(body, executor, Phase::decide(Skill::Palpate, 0))?;
        let kinematics = self.world.cell.kinematics();
        // By the encoders, not as commanded.
        let palm = kinematics.palm_pose(&executor.motion().arm().position);
        let prior = PosePrior {
            palm_from_object: palm.inverse() * detected.pose(),
            sigma_translation: self.position_sigma(round),
            sigma_rotation: BALL_ROTATION_SIGMA,
        };
        let found = estimate_touched_pose(senses, &executor.motion().snapshot(), &self.ball, &prior, None)?;
        executor.step_aside(0)?;
        run_phase(body, executor, Phase::decide(Skill::StepAside, 0))?;
        Ok(found.map(|found| {
            let turn = palm.rotation.to_rotation_matrix().into_inner();
            let covariance = turn * found.covariance.fixed_view::<3, 3>(0, 0) * turn.transpose();
            (palm * Point3::from(found.palm_from_object.translation.vector), covariance)
        }))
    }
}

/// Runs until `phase`.
fn run_phase(body: &mut dyn TrialBackend, executor: &mut Executor, phase: Phase) -> Result<()> {
    let mut left = (MOTION_TIMEOUT / body.tick_length()) as u64;
    let mut outage = Outage::default();
    while executor.phase() != phase {
        tick(body, executor, &mut outage)?;
        left = left.saturating_sub(1);
        if left == 0 {
            bail!("phase: found {} at the time limit, expected {}", executor.phase().name(), phase.name());
        }
    }
    // The next step is computed first.
    body.pause();
    Ok(())
}

fn tick(body: &mut dyn TrialBackend, executor: &mut Executor, outage: &mut Outage) -> Result<()> {
    let failed = match outage.record_observation(body.observe()) {
        Ok(Some(observation)) => {
            let command = executor.tick(&observation)?;
            outage.record_send(body.send(&command)).err()
        }
        Ok(None) => None,
        Err(error) => Some(error),
    };
    body.wait_for_tick();
    match body.stop_reason() {
        Some(why) => bail!(TrialStopped(format!("{why} (phase: {})", executor.phase().name()))),
        None => failed.map_or(Ok(()), |error| bail!(TrialStopped(error.to_string()))),
    }
}

/// Returns the error of `found` against `truth`: of the position of `middle`, m, and of the rotation, rad. It is for
/// evaluation.
pub fn registration_error(found: &Isometry3<f64>, truth: &Isometry3<f64>, middle: &Point3<f64>) -> (f64, f64) {
    let base = truth.inverse() * middle;
    ((found * base - middle).norm(), found.rotation.angle_to(&truth.rotation))
}
