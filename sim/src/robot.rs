//! The simulated robot behind [`hand_model::robot::RobotBackend`], and the separate access to ground truth.

mod backend;
mod external;
mod fault_injection;
mod measured_servos;
mod object_changes;
mod self_contact;
mod set_points;
mod visibility;

use std::collections::VecDeque;
use std::sync::Arc;

use hand_model::hand::MAX_HAND_JOINTS;
use hand_model::robot::{ArmState, Observation, RobotCommand, Tick};
use hand_model::{Arm, ArmVector, Digit, Hand, RobotModel};
use nalgebra::{Isometry3, Translation3, Vector3};
use plant::ArmDefects;
use plant::CameraFailure;
use plant::GelViscoelasticity;
use rapier3d_f64::prelude::*;
use world::geometry::ObjectShape;
use world::objects::ObjectModel;
use world::physics::{Physics, TablePhysics};

use crate::body::{ArmGoal, JointState, RobotBody, groups, last_from_palm};
use crate::contacts::{contacts_of, normal_force};
use crate::convert;
use crate::drive::HandDrive;
use crate::engine::{Engine, EngineSettings};
use crate::gel::SoftCovers;
use crate::scene::{insert_floor, insert_object};
use crate::tactile::{PadLoads, TactileBoard};
use external::{AppliedForce, ExternalDisturbances};
use fault_injection::RobotFaults;
use set_points::{SetPoint, SetPointLimits};

pub use crate::scene::{HandPosture, ObjectPlacement, SceneSetup};
pub use crate::truth::{GroundTruth, HandContact, ObjectContact};

/// Number of physics steps in one control tick (240 Hz / 2 = 120 Hz).
const STEPS_PER_TICK: usize = 2;

/// The simulated robot. Cloning it branches the run bit-exactly.
#[derive(Clone)]
pub struct SimulatedRobot {
    hand: Arc<Hand>,
    arm: Arc<Arm>,
    defects: ArmDefects,
    last_from_palm: Isometry3<f64>,
    engine: Engine,
    body: RobotBody,
    objects: Vec<InsertedObject>,
    table: ColliderHandle,
    /// The floor with the height of its surface, m.
    floor: Option<(ColliderHandle, f64)>,
    drive: HandDrive,
    state: JointState,
    arm_torque: ArmVector,
    previous_goal: ArmVector,
    set_points: ArmVector<SetPoint>,
    capture: bool,
    time: f64,
    sequence: u64,
    touched_by: Vec<u32>,
    object_pairs: Vec<(usize, usize)>,
    on_table: Vec<bool>,
    collides: bool,
    tactile: TactileBoard,
    frames: Vec<hand_model::robot::TactileFrame>,
    /// Latency from exposure to [`Self::observe`], s.
    frame_delay: f64,
    /// Frames in transit, with their arrival times, s.
    frames_in_transit: VecDeque<(f64, Vec<hand_model::robot::TactileFrame>)>,
    self_contact: bool,
    external: ExternalDisturbances,
    faults: RobotFaults,
}

/// An object's model, body and collider.
type InsertedObject = (Arc<ObjectModel>, RigidBodyHandle, ColliderHandle);

/// Creates the compliant covers of a robot in a scene with these objects.
fn soft_covers(
    hand: &Hand,
    gel: &GelViscoelasticity,
    (body, objects): (&RobotBody, &[InsertedObject]),
    colliders: &mut ColliderSet,
) -> SoftCovers {
    let links = std::iter::once(None).chain((0..hand.covers.len()).map(Some));
    let covers = body.covers.iter().copied().zip(links);
    let objects = objects.iter().map(|(model, _, collider)| (*collider, model.clone()));
    SoftCovers::new(hand, gel, covers, objects, colliders)
}

impl SimulatedRobot {
    /// Builds the scene with the hand open.
    pub fn new(robot: &RobotModel, setup: &SceneSetup, tactile: TactileBoard) -> Self {
        Self::in_posture(robot, setup, &HandPosture::open(&robot.hand), tactile)
    }

    /// Builds the scene with the hand in `posture`, at rest.
    pub fn in_posture(robot: &RobotModel, setup: &SceneSetup, posture: &HandPosture, tactile: TactileBoard) -> Self {
        let (hand, arm) = (robot.hand.clone(), robot.arm.clone());
        let mut engine = Engine::new(setup.engine);
        let defects = setup.arm_defects;
        let start = defects.true_angles(&setup.arm_start);
        let body =
            RobotBody::insert(&mut engine, &arm, &hand, &setup.world_from_base, &defects, (&start, &posture.joints));
        let TablePhysics { center, half, .. } = Physics::standard().table;
        let table_shape = ColliderBuilder::cuboid(half[0], half[1], half[2])
            .position(Pose::from_translation(Vector::new(center[0], center[1], center[2])))
            .friction(setup.engine.table_friction)
            .friction_combine_rule(CoefficientCombineRule::Min)
            .collision_groups(InteractionGroups::all().with_memberships(groups::TABLE));
        let table = engine.colliders.insert(table_shape);
        let objects: Vec<_> = setup.objects.iter().map(|placement| insert_object(&mut engine, placement)).collect();
        let floor = setup.floor.map(|height| (insert_floor(&mut engine, height), height));
        engine.soft_covers =
            setup.gel.map(|gel| soft_covers(&hand, &gel, (&body, &objects[..]), &mut engine.colliders));
        let state = body.joint_state(&engine);
        let count = objects.len();
        Self {
            drive: HandDrive::new(&hand, setup.cables).with_angles(&posture.servos),
            defects,
            last_from_palm: last_from_palm(&arm, &hand, &defects),
            hand,
            arm,
            engine,
            body,
            objects,
            table,
            floor,
            state,
            arm_torque: robot.arm.each(|_| 0.0),
            previous_goal: setup.arm_start,
            set_points: setup.arm_start.into_iter().map(SetPoint::new).collect(),
            capture: false,
            time: 0.0,
            sequence: 0,
            touched_by: vec![0; count],
            object_pairs: Vec::new(),
            on_table: vec![false; count],
            collides: false,
            tactile,
            frames: Vec::new(),
            frame_delay: setup.frame_delay,
            frames_in_transit: VecDeque::new(),
            self_contact: setup.self_contact,
            external: ExternalDisturbances::default(),
            faults: RobotFaults::default(),
        }
    }

    /// Returns the encoder angles that the arm should show at the end of the tick, rad.
    fn goal(&self) -> ArmVector {
        self.set_points.iter().map(|joint| joint.angle).collect()
    }

    fn step(&mut self, goal: &ArmGoal) {
        let dt = self.engine.settings.dt;
        let state = self.state;
        let poses = self.body.link_poses(&self.engine);
        let gravity = self.body.gravity_torques(&poses);
        self.arm_torque = self.body.drive_arm(&mut self.engine, &self.arm, &state, goal, &gravity);
        let efforts = self.drive.step(&self.hand, &state.hand, &state.hand_speed, dt);
        for (joint, effort) in efforts.iter().enumerate() {
            let effort = self.faults.effort_with_faults(joint, state.hand[joint], *effort);
            self.body.drive_finger(&mut self.engine, &state, joint, effort.torque, effort.stiffness);
        }
        self.engine.step();
        self.resist_rolling();
        self.state = self.body.joint_state(&self.engine);
        self.time += dt;
    }

    /// Applies rolling resistance to objects on table or floor: a torque of the normal force times the lever arm of
    /// rolling resistance.
    fn resist_rolling(&mut self) {
        let EngineSettings { dt, rolling_resistance, .. } = self.engine.settings;
        for (_, body, collider) in &self.objects {
            let mut force = normal_force(&self.engine, *collider, self.table);
            let mut ground = 0.0;
            if let Some((floor, height)) = self.floor.filter(|_| force <= 0.0) {
                (force, ground) = (normal_force(&self.engine, *collider, floor), height);
            }
            let body = &mut self.engine.bodies[*body];
            let (spin, height) = (body.angvel(), (body.center_of_mass().z - ground).max(0.0));
            let speed = spin.length();
            if force <= 0.0 || speed <= 0.0 {
                continue;
            }
            let inverse_inertia = body.mass_properties().effective_world_inv_inertia;
            let slowed = (inverse_inertia * (spin / speed)).length() * rolling_resistance * force * height * dt;
            body.set_angvel(spin * (1.0 - (slowed / speed).min(1.0)), false);
        }
    }

    fn record_contacts(&mut self) {
        for (index, (_, _, collider)) in self.objects.iter().enumerate() {
            for pair in self.engine.narrow_phase.contact_pairs_with(*collider) {
                if !bears_load(pair) {
                    continue;
                }
                let other = if pair.collider1 == *collider { pair.collider2 } else { pair.collider1 };
                if other == self.table {
                    self.on_table[index] = true;
                } else if let Some(cover) = self.body.covers.iter().position(|c| *c == other) {
                    self.touched_by[index] |= if cover == 0 { 1 << MAX_HAND_JOINTS } else { 1 << (cover - 1) };
                } else if let Some(second) = self.objects.iter().position(|(_, _, c)| *c == other)
                    && index < second
                    && !self.object_pairs.contains(&(index, second))
                {
                    self.object_pairs.push((index, second));
                } else {
                    self.collides |= self.body.wrist.contains(&other);
                }
            }
        }
        let grounds = std::iter::once(self.table).chain(self.floor.map(|(floor, _)| floor));
        for ground in grounds {
            let robot = |collider| self.body.covers.contains(&collider) || self.body.wrist.contains(&collider);
            let mut pairs = self.engine.narrow_phase.contact_pairs_with(ground);
            self.collides |= pairs.any(|pair| (robot(pair.collider1) || robot(pair.collider2)) && bears_load(pair));
        }
    }

    /// Computes the true `world_from_palm`.
    fn palm(&self, poses: &[Isometry3<f64>]) -> Isometry3<f64> {
        poses[self.arm.last_link()] * self.last_from_palm
    }

    /// True if, in the last tick, object `index` touched another object or one of the links in `links` (bits as in
    /// [`GroundTruth::touched_by`]). A cheap part of [`SimulatedRobot::truth`].
    pub fn is_touched(&self, index: usize, links: u32) -> bool {
        self.touched_by[index] & links != 0 || self.object_pairs.iter().any(|pair| pair.0 == index || pair.1 == index)
    }

    /// Adds `change` (m/s) to the velocity of object `index`: an external disturbance for experiments and tests.
    pub fn add_velocity(&mut self, index: usize, change: &Vector3<f64>) {
        let body = &mut self.engine.bodies[self.objects[index].1];
        let velocity = body.linvel() + convert::vector(change);
        body.set_linvel(velocity, true);
    }

    /// Applies an external force (N, world axes) during the next tick to object `on`, at its centre of mass, or to the
    /// palm at its origin.
    pub fn apply_force(&mut self, on: Option<usize>, force: Vector3<f64>) {
        self.external.add_force(on, force);
    }

    /// Scales the friction of object `index` to `factor` times that of its model from now on.
    pub fn set_friction(&mut self, index: usize, factor: f64) {
        let (model, _, collider) = &self.objects[index];
        self.engine.colliders[*collider].set_friction(factor * model.friction);
    }

    /// Cuts the power of these digits' servos from now on; the thumb's opposition is cut with the thumb.
    pub fn cut_power(&mut self, digits: &[Digit]) {
        self.external.cut_power(digits);
    }

    /// Makes the cameras of the named pads fail from now on.
    pub fn fail_cameras(&mut self, pads: &[String], how: CameraFailure) {
        let named = self.hand.pads.iter().filter(|pad| pads.contains(&pad.name));
        self.external.fail_cameras(named.flat_map(|pad| pad.cameras.iter().copied()), how);
    }

    /// Returns the external forces of this tick, each with its body and point of application.
    fn external_forces(&mut self) -> Vec<AppliedForce> {
        let forces = self.external.take_forces();
        let on = |(on, force): (Option<usize>, Vector3<f64>)| match on {
            Some(object) => AppliedForce { body: self.objects[object].1, point: None, force },
            None => {
                let palm = self.palm(&self.body.link_poses(&self.engine)).translation.vector;
                AppliedForce { body: self.body.palm_link(), point: Some(palm), force }
            }
        };
        forces.into_iter().map(on).collect()
    }

    /// Returns the time since the robot was started, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Returns the ground truth, for the referee and the recording only.
    pub fn truth(&self) -> GroundTruth {
        let links = self.body.link_poses(&self.engine);
        let objects: Vec<_> =
            self.objects.iter().map(|(_, body, _)| convert::to_pose(self.engine.bodies[*body].position())).collect();
        let velocities =
            self.objects.iter().map(|(_, body, _)| convert::to_vector(self.engine.bodies[*body].linvel())).collect();
        let (mut contacts, mut object_contacts) = (Vec::new(), Vec::new());
        let palm = self.palm(&links);
        let mut pad_forces = vec![0.0; self.hand.pads.len()];
        for (object, (_, _, collider)) in self.objects.iter().enumerate() {
            for contact in contacts_of(&self.engine, *collider) {
                let Some(cover) = self.body.covers.iter().position(|c| *c == contact.other) else {
                    let second = self.objects.iter().position(|(_, _, c)| *c == contact.other);
                    object_contacts.extend(second.filter(|second| object < *second).map(|second| ObjectContact {
                        objects: (object, second),
                        point: contact.point,
                        force: contact.force,
                    }));
                    continue;
                };
                let link = cover.checked_sub(1);
                contacts.push(HandContact {
                    object,
                    link,
                    point: contact.point,
                    force: -contact.normal * contact.force,
                });
                if let Some(pad) = self.pad_at(link, &contact.point, &contact.normal, &links, &palm) {
                    pad_forces[pad] += contact.force;
                }
            }
        }
        GroundTruth {
            time: self.time,
            objects,
            velocities,
            palm,
            hand: self.state.hand.to_vec(),
            tensions: self.drive.tensions,
            contacts,
            object_contacts,
            touched_by: self.touched_by.clone(),
            object_pairs: self.object_pairs.clone(),
            on_table: self.on_table.clone(),
            collides: self.collides,
            pad_forces,
            arm_links: links[..self.arm.joints()].to_vec(),
            hand_links: links[self.arm.joints()..].to_vec(),
        }
    }

    /// Returns the pad of `link` on which a contact from outside lies, if any. `normal` points away from the object.
    fn pad_at(
        &self,
        link: Option<usize>,
        point: &nalgebra::Point3<f64>,
        normal: &Vector3<f64>,
        links: &[Isometry3<f64>],
        palm: &Isometry3<f64>,
    ) -> Option<usize> {
        self.hand.pads.iter().position(|pad| {
            if pad.link != link {
                return false;
            }
            let world = pad.link.map_or(*palm, |link| links[self.arm.joints() + link]) * pad.link_from_pad;
            let local = world.inverse_transform_point(point);
            let inward = world.inverse_transform_vector(normal);
            local.x.abs() < 0.5 * pad.w && local.y.abs() < 0.5 * pad.h && inward.z < -0.4
        })
    }

    /// Computes the shear displacement of the surface of a pad at `world_from_pad` on `link`, pad frame, m: that of the
    /// gel of the link's cover under friction, averaged over the objects that press into it.
    fn shear(&self, link: Option<usize>, world_from_pad: &Isometry3<f64>) -> Vector3<f64> {
        let Some(covers) = &self.engine.soft_covers else { return Vector3::zeros() };
        let gives =
            (0..self.objects.len()).filter_map(|object| covers.cover_response(link.map_or(0, |link| link + 1), object));
        let (sum, force) = gives
            .fold((Vector3::zeros(), 0.0), |(sum, force), give| (sum + give.shear * give.force, force + give.force));
        let mean = if force > 0.0 { sum / force } else { Vector3::zeros() };
        let local = world_from_pad.inverse_transform_vector(&mean);
        Vector3::new(local.x, local.y, 0.0)
    }

    fn capture_tactile(&mut self) {
        let truth = self.truth();
        let own = self.self_loads();
        let pads: Vec<Isometry3<f64>> = self
            .hand
            .pads
            .iter()
            .map(|pad| {
                let world = pad.link.map_or(truth.palm, |link| truth.hand_links[link]) * pad.link_from_pad;
                // The image is displaced with the surface: shift the pad the other way.
                if self.engine.soft_covers.is_some() {
                    world * Translation3::from(-self.shear(pad.link, &world))
                } else {
                    world
                }
            })
            .collect();
        let objects: Vec<(&ObjectShape, Isometry3<f64>)> =
            self.objects.iter().zip(&truth.objects).map(|((model, _, _), pose)| (&model.shape, *pose)).collect();
        let loads = PadLoads { pads: &pads, forces: &truth.pad_forces, objects: &objects, self_loads: &own };
        let mut frames = self.tactile.capture_loads(&self.hand, self.time, &loads);
        self.external.drop_failed_frames(&mut frames);
        self.faults.corrupt_images(&mut frames);
        self.frames_in_transit.push_back((self.time + self.frame_delay, frames));
    }

    /// Moves frames that have arrived by now to the output.
    fn receive_frames(&mut self) {
        // Tolerance of half a physics step, because times are sums of steps.
        let now = self.time + 0.5 * self.engine.settings.dt;
        while let Some((_, frames)) = self.frames_in_transit.pop_front_if(|(arrives, _)| *arrives <= now) {
            self.frames.extend(frames);
        }
    }
}

/// True if a contact pair bears load.
fn bears_load(pair: &ContactPair) -> bool {
    pair.solver_manifolds().iter().any(|manifold| manifold.points.iter().any(|point| point.data.impulse > 0.0))
}

/// The methods of [`RobotBackend`](hand_model::robot::RobotBackend), which never fail in simulation.
impl SimulatedRobot {
    /// Returns the newest measurements, with the images that arrived since the last ones.
    pub fn observe(&mut self) -> Observation {
        Observation {
            time: self.time,
            sequence: self.sequence,
            servos: self.drive.states(),
            arm: ArmState {
                position: self.defects.encoder_readings(&self.state.arm),
                velocity: self.state.arm_speed,
                torque: self.arm.each(|joint| self.arm.torque_gains[joint] * self.arm_torque[joint]),
            },
            tactile: std::mem::take(&mut self.frames),
        }
    }

    /// Takes a command and returns the one that is followed, after the arm's limits.
    pub fn send(&mut self, command: &RobotCommand) -> RobotCommand {
        let mut sent = *command;
        let tick = self.tick_length();
        self.previous_goal = self.goal();
        for (i, goal) in sent.arm.iter_mut().enumerate() {
            let joint = &self.arm.tree.joints[i];
            let limits =
                SetPointLimits { speed: self.arm.velocity_limits[i], acceleration: self.arm.acceleration_limits[i] };
            *goal = self.set_points[i].follow(goal.clamp(joint.lower, joint.upper), limits, tick);
        }
        self.external.cut_current(&mut sent);
        self.drive.set_goals(&sent.servos);
        self.capture = sent.capture;
        sent
    }

    /// Advances the scene by one control tick.
    pub fn wait_for_tick(&mut self) -> Tick {
        self.touched_by.fill(0);
        self.collides = false;
        self.object_pairs.clear();
        self.on_table.fill(false);
        let (tick, goal) = (self.tick_length(), self.goal());
        let speed = self.arm.each(|i| (goal[i] - self.previous_goal[i]) / tick);
        let pulled = self.external_forces();
        ExternalDisturbances::apply_forces(&pulled, &mut self.engine);
        for n in 1..=STEPS_PER_TICK {
            let part = n as f64 / STEPS_PER_TICK as f64;
            let shown: ArmVector = self.arm.each(|i| self.previous_goal[i] + part * (goal[i] - self.previous_goal[i]));
            self.step(&ArmGoal { position: self.defects.true_angles(&shown), speed });
            self.record_contacts();
        }
        ExternalDisturbances::clear_forces(&pulled, &mut self.engine);
        self.previous_goal = goal;
        self.sequence += 1;
        if std::mem::take(&mut self.capture) {
            self.capture_tactile();
        }
        self.receive_frames();
        Tick { time: self.time, lateness: 0.0 }
    }

    /// Returns the length of a control tick, s.
    pub fn tick_length(&self) -> f64 {
        STEPS_PER_TICK as f64 * self.engine.settings.dt
    }
}
