//! World of the simulated robot, shared by every command that moves it: the robot, its base pose, and the objects.

use std::sync::Arc;

use anyhow::{Context, Result, anyhow, bail};
use control::detection::DetectedObject;
use control::executor::{Executor, Phase};
use control::inverse_kinematics::Joints;
use control::motion::MotionProtocol;
use control::trajectory::PathLimits;
use control::workcell::Workcell;
use hand_model::transmission::friction::{CableFriction, CableLosses};
use hand_model::{ArmVector, RobotModel};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use plant::ArmDefects;
use scenarios::Scenario;
use scenarios::noise::TrialNoise;
use sim::{ObjectPlacement, SceneSetup, SimulatedRobot};
use world::objects::{ObjectModel, ObjectSet};

/// Setup that every trial of a scenario shares.
#[derive(Clone)]
pub struct SimulatedWorld {
    /// The control stack's robot model, and its base pose.
    pub cell: Workcell,
    /// All objects, in every resting pose, also fallen over.
    pub objects: ObjectSet,
    /// Task and success criteria.
    pub scenario: Scenario,
    /// True pose of the arm's base in the simulated world, before a trial's own errors. The controller uses
    /// `cell.world_from_base`.
    pub true_world_from_base: Isometry3<f64>,
    /// The simulated robot if it differs from the control stack's model.
    pub plant: Option<RobotModel>,
}

impl SimulatedWorld {
    /// Creates a world in which the control stack's model equals the robot, among the objects of a scenario.
    ///
    /// # Errors
    /// Returns an error if the scenario's start is out of the arm's reach, or if an object of it cannot be read.
    pub fn new(robot: &RobotModel, scenario: Scenario) -> Result<Self> {
        if let Err((field, found, expected)) = scenario.disturbance.check_pads(&robot.hand) {
            bail!("{}: {field}: found {found}, expected {expected}", scenario.name);
        }
        let mut cell =
            Workcell { robot: robot.clone(), world_from_base: Isometry3::identity(), ready_posture: robot.arm.home };
        let columns = Matrix3::from_columns(&[-Vector3::y(), Vector3::x(), Vector3::z()]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns));
        let [x, y, z] = scenario.start.palm;
        let pitched = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -robot.start_pitch);
        let palm = Isometry3::from_parts(Translation3::new(x, y, z), rotation * pitched);
        cell.ready_posture = cell.posture(&palm, &robot.arm.home).with_context(|| {
            format!(
                "{}: arm: found one that does not reach the palm's start pose {:?} m, expected one that does",
                robot.name,
                [x, y, z]
            )
        })?;
        let objects = scenario.object_set()?.with_fallen();
        Ok(Self { cell, objects, scenario, true_world_from_base: Isometry3::identity(), plant: None })
    }

    /// Returns the simulated robot.
    pub fn simulated_robot(&self) -> &RobotModel {
        self.plant.as_ref().unwrap_or(&self.cell.robot)
    }

    /// Returns the world with the two places of the layout swapped: the object that is taken first stands in the second
    /// place, and the other in the first.
    #[must_use]
    pub fn with_places_swapped(&self) -> Self {
        let mut other = self.clone();
        std::mem::swap(&mut other.scenario.layout.first, &mut other.scenario.layout.second);
        other
    }

    /// Returns the arm posture for a palm pose, or an error if it is out of reach.
    pub fn posture(&self, palm: &Isometry3<f64>, seed: &Joints) -> Result<Joints> {
        self.cell
            .posture(palm, seed)
            .ok_or_else(|| anyhow!("no arm posture reaches the palm at {:.3?}", palm.translation.vector.as_slice()))
    }

    /// Returns the poses of a trial's objects: the places of the layout, with the shifts drawn for the trial.
    pub fn object_poses(&self, objects: &[Arc<ObjectModel>], noise: &TrialNoise) -> Vec<Isometry3<f64>> {
        let places = self.scenario.layout.places().into_iter().zip(&noise.shifts);
        places.zip(objects).map(|((place, shift), object)| place.shifted(shift).pose(object)).collect()
    }

    /// Returns the objects in their places as detected under `noise`.
    pub fn detected_objects(&self, objects: &[Arc<ObjectModel>], noise: &TrialNoise) -> Vec<DetectedObject> {
        let poses = self.object_poses(objects, noise).into_iter().zip(&noise.objects);
        poses
            .zip(objects)
            .map(|((pose, error), object)| DetectedObject::from_pose(object, &error.perceived_pose(&pose)))
            .collect()
    }

    /// Returns the scene of a trial: the objects in their places, and the arm in posture `start` with the errors of
    /// `noise`.
    pub fn scene(&self, objects: &[Arc<ObjectModel>], start: ArmVector, noise: &TrialNoise) -> SceneSetup {
        SceneSetup {
            objects: objects
                .iter()
                .zip(self.object_poses(objects, noise))
                .map(|(model, pose)| ObjectPlacement { model: model.clone(), pose })
                .collect(),
            ..self.bare_scene(start, noise)
        }
    }

    /// Returns the scene of a trial without any object.
    pub fn bare_scene(&self, start: ArmVector, noise: &TrialNoise) -> SceneSetup {
        SceneSetup {
            world_from_base: Isometry3::from_parts(noise.position.into(), UnitQuaternion::identity())
                * self.true_world_from_base,
            arm_defects: ArmDefects { mount_rotation: noise.rotation + noise.arm.mount_rotation, ..noise.arm },
            arm_start: start,
            objects: Vec::new(),
            frame_delay: self.scenario.effects.time.map_or(0.0, |time| time.frame),
            floor: self.scenario.effects.floor.map(|floor| floor.height),
            self_contact: self.scenario.effects.pads.is_some_and(|pads| pads.self_contact),
            cables: self.cable_losses(),
            gel: self.scenario.effects.gel,
            engine: sim::engine::EngineSettings::default(),
        }
    }

    /// Returns the losses in the cables and gears of the scenario's hand: friction and backlash.
    pub fn cable_losses(&self) -> CableLosses {
        let CableFriction { coefficient, .. } = self.cell.robot.hand.parameters.cable.friction;
        self.scenario.effects.cables.map_or(CableLosses::NONE, |cables| CableLosses {
            friction: CableFriction {
                coefficient: cables.friction * coefficient,
                ..self.cell.robot.hand.parameters.cable.friction
            },
            backlash: cables.backlash,
        })
    }

    /// Returns the cable losses in the controller's model: the guide friction of the hand's data file and the backlash
    /// of the gear's data sheet.
    pub fn known_cable_losses(&self) -> CableLosses {
        self.scenario.effects.cables.map_or(CableLosses::NONE, |cables| CableLosses {
            friction: self.cell.robot.hand.parameters.cable.friction,
            backlash: cables.backlash,
        })
    }

    /// Returns the distances and times of a trial for the executor.
    pub fn protocol(&self) -> MotionProtocol {
        let p = &self.scenario.protocol;
        MotionProtocol {
            lift: p.lift_height,
            carry_distance: p.carry_distance,
            hold_time: p.hold_time,
            limits: PathLimits::default(),
            friction: self.known_cable_losses().friction,
        }
    }

    /// Returns the protocol of rollouts: the trial's own with a shorter hold.
    pub fn rollout_protocol(&self) -> MotionProtocol {
        MotionProtocol { hold_time: 1.0, ..self.protocol() }
    }

    /// Returns objects by name.
    pub fn models(&self, names: &[&str]) -> Result<Vec<Arc<ObjectModel>>> {
        names.iter().map(|name| self.object(name)).collect()
    }

    /// Returns an object by name.
    pub fn object(&self, name: &str) -> Result<Arc<ObjectModel>> {
        self.objects
            .get(name)
            .cloned()
            .ok_or_else(|| anyhow!("object: found `{name}`, expected one of {}", self.objects.names().join(", ")))
    }
}

/// Drives `robot` with `executor` until `phase` is reached. `watch` is called after every tick.
pub fn drive(
    robot: &mut SimulatedRobot,
    executor: &mut Executor,
    until: Phase,
    mut watch: impl FnMut(&SimulatedRobot, &Executor),
) -> Result<()> {
    while executor.phase() != until {
        tick(robot, executor)?;
        watch(robot, executor);
    }
    Ok(())
}

/// Runs one tick of `robot` with the command of `executor`.
pub fn tick(robot: &mut SimulatedRobot, executor: &mut Executor) -> Result<()> {
    let command = executor.tick(&robot.observe())?;
    robot.send(&command);
    robot.wait_for_tick();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use dexterous_grasping::digit_sets;
    use scenarios::generator::trial_rng;
    use scenarios::noise::draw_shifts;

    /// Objects and their detected poses are in the drawn places. The planned noiseless run is in the nominal ones.
    #[test]
    fn a_spread_moves_objects_and_what_is_seen_of_them() {
        let mut scenario = Scenario::benchmark();
        (scenario.layout.spread_xy, scenario.layout.spread_yaw) = (0.02, 0.3);
        let world = SimulatedWorld::new(&RobotModel::ftac_gen3(), scenario).unwrap();
        let objects = [world.object("box_50").unwrap(), world.object("pear").unwrap()];
        let shifts = draw_shifts(&world.scenario.layout, 2, &mut trial_rng(1, 0, 0));
        let noise = TrialNoise { shifts, ..TrialNoise::none() };
        let (seen, scene) =
            (world.detected_objects(&objects, &noise), world.scene(&objects, world.cell.ready_posture, &noise));
        let nominal = world.object_poses(&objects, &TrialNoise::none());
        for n in 0..2 {
            let world::layout::PlacementShift { x, y, .. } = shifts[n];
            let moved = scene.objects[n].pose.translation.vector - nominal[n].translation.vector;
            assert!((moved - Vector3::new(x, y, 0.0)).norm() < 1e-12 && moved.norm() > 0.0);
            assert_eq!(seen[n].position.coords, scene.objects[n].pose.translation.vector);
        }
        assert!((seen[0].yaw - shifts[0].yaw).abs() < 1e-9);
    }

    /// Returns the root mean square of the palm's position and rotation error per axis, over drawn arms and the
    /// postures of the repertoire's grasps in their places.
    fn palm_errors(world: &SimulatedWorld) -> (f64, f64) {
        let repertoire = crate::builtin::repertoire().unwrap();
        let layout = &world.scenario.layout;
        let (arm, hand, errors) = (&world.cell.robot.arm, &world.cell.robot.hand, world.scenario.effects.arm.unwrap());
        let palm =
            |q: &Joints, defects: &ArmDefects| arm.tool_pose(q) * defects.mount() * hand.palm_from_flange.inverse();
        let (mut squares, mut turns, mut count) = (0.0, 0.0, 0.0);
        for name in world.scenario.object_names() {
            let object = world.object(&name).unwrap();
            for (digits, place) in digit_sets(hand, 2).iter().zip([layout.first, layout.second]) {
                let Some(grasp) = repertoire.for_digits(&name, digits).next() else { continue };
                let center = place.pose(&object).translation.vector.into();
                let Ok(posture) = world.posture(&grasp.palm_pose(&center, place.yaw), &world.cell.ready_posture) else {
                    continue;
                };
                for trial in 0..200 {
                    let defects = errors.draw(&mut trial_rng(1, count as usize, trial));
                    let off =
                        palm(&posture, &ArmDefects::default()).inv_mul(&palm(&defects.true_angles(&posture), &defects));
                    squares += off.translation.vector.norm_squared() / 3.0;
                    turns += off.rotation.scaled_axis().norm_squared() / 3.0;
                    count += 1.0;
                }
            }
        }
        ((squares / count).sqrt(), (turns / count).sqrt())
    }

    /// The errors of joints, mount and load are as large at the palm as the constant error that they replace.
    #[test]
    fn arm_errors_are_as_large_as_the_constant_one() {
        let world = SimulatedWorld::new(&RobotModel::ftac_gen3(), Scenario::benchmark()).unwrap();
        let (position, rotation) = palm_errors(&world);
        println!("{:.2} mm, {:.1} mrad", position * 1e3, rotation * 1e3);
        let constant = world.scenario.noise.execution;
        assert!((position / constant.position_sigma - 1.0).abs() < 0.1, "{position} m");
        assert!((rotation / constant.rotation_sigma - 1.0).abs() < 0.15, "{rotation} rad");
    }
}
