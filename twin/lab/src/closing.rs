//! Closing of any hand on a ball: contact force on each link, directions of gravity against which the ball is held, and
//! a picture.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use hand_model::hand_mechanism::HandMechanism;
use hand_model::kinematics::{Joint, JointKind};
use nalgebra::{Isometry3, Point3, Vector3};
use report::picture::{PROP_COLORS, Picture, View, save, tile};
use schemars::JsonSchema;
use serde::Serialize;
use sim::collision_model::CollisionModel;
use sim::hand_scene::{HandScene, TensionCommand};
use sim::test_stand::Prop;
use world::ObjectShape;

/// Time limits, s: closing on the fixed ball, settling after its release, and gravity along each direction.
const CLOSING_TIME: f64 = 2.0;
const SETTLING_TIME: f64 = 1.0;
const PULL_TIME: f64 = 1.0;
/// Mass of the ball, kg, and its friction coefficient.
const BALL_MASS: f64 = 0.1;
const BALL_FRICTION: f64 = 0.8;
/// Hold criterion: the ball moves less than this, m.
const HOLD_DISPLACEMENT: f64 = 0.01;
/// Contact threshold on the force of a link, N.
const CONTACT_FORCE_THRESHOLD: f64 = 0.05;
const HAND_COLOR: [f64; 3] = [176.0, 182.0, 192.0];

/// Minimum number of touching links of a grip.
const MIN_GRIP_LINKS: usize = 2;

/// State of a joint of the closed hand.
#[derive(Debug, Serialize, JsonSchema)]
struct ClosedJoint {
    joint: String,
    /// Angle of a revolute joint, rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    angle_rad: Option<f64>,
    /// Position of a prismatic joint, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    position_m: Option<f64>,
    /// Contact force on its link, N.
    force_n: f64,
}

/// Result: state of each joint, and motion of the ball under gravity.
#[derive(Debug, Serialize, JsonSchema)]
pub struct BallGripFigures<'a> {
    /// Name of the hand.
    hand: &'a str,
    joints: Vec<ClosedJoint>,
    /// Number of links in contact.
    touching: usize,
    /// Number of directions of gravity, of six, against which the ball is held.
    held_directions: usize,
    /// Motion of the object under gravity along each axis, mm.
    moved_mm: BTreeMap<&'static str, f64>,
    /// Findings about the hand; warnings begin with WARNING.
    notes: &'a [String],
}

/// Grip of a hand that has closed on a ball.
pub struct BallGrip {
    hand: Arc<HandMechanism>,
    model: CollisionModel,
    open: HandScene,
    closed: HandScene,
    ball: Prop,
    /// Contact force on each link, N.
    forces: Vec<f64>,
    /// Motion of the ball under gravity along each axis, m.
    moved: Vec<(&'static str, f64)>,
}

impl BallGrip {
    /// Closes `hand` with these tensions (N, one per actuator) on a ball of `radius` (m) held at `at` (root link's
    /// frame, m).
    pub fn close(hand: Arc<HandMechanism>, tensions: &[f64], at: &Point3<f64>, radius: f64) -> Self {
        let model = CollisionModel::new(hand.clone());
        let open = HandScene::new(&model, &hand.rest_coordinates());
        let pull = TensionCommand::tensions(tensions);
        let mut closed = open.clone();
        let ball = Prop::new("ball", ObjectShape::Sphere { radius }, BALL_MASS, BALL_FRICTION);
        closed.add_prop(&ball, &Isometry3::translation(at.x, at.y, at.z));
        closed.run(&pull, CLOSING_TIME);
        closed.release();
        closed.run(&pull, SETTLING_TIME);
        let forces = closed.link_forces();
        let start = closed.objects()[0].translation.vector;
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        let directions = [("+x", x), ("-x", -x), ("+y", y), ("-y", -y), ("+z", z), ("-z", -z)];
        let moved = directions.map(|(name, direction)| {
            let mut branch = closed.clone();
            branch.set_gravity(&(direction * 9.81));
            branch.run(&pull, PULL_TIME);
            (name, (branch.objects()[0].translation.vector - start).norm())
        });
        Self { hand, model, open, closed, ball, forces, moved: moved.to_vec() }
    }

    fn touching(&self) -> usize {
        self.forces.iter().filter(|force| **force > CONTACT_FORCE_THRESHOLD).count()
    }

    /// Returns the directions of gravity against which the ball is held.
    fn holding_directions(&self) -> Vec<&'static str> {
        self.moved.iter().filter(|(_, moved)| *moved < HOLD_DISPLACEMENT).map(|(name, _)| *name).collect()
    }

    /// Returns the reason why the grip is insufficient, if it is.
    pub fn shortfall(&self) -> Option<String> {
        let touching = self.touching();
        (touching < MIN_GRIP_LINKS).then(|| format!("{touching} links touch the ball; a grip needs two"))
    }

    pub fn figures(&self) -> BallGripFigures<'_> {
        let hand = &self.hand;
        let joints = hand.tree.joints.iter().zip(self.closed.angles().iter().zip(&self.forces));
        let joint = |(joint, (at, force)): (&Joint, (&f64, &f64))| ClosedJoint {
            joint: joint.name.clone(),
            angle_rad: matches!(joint.kind, JointKind::Turn).then_some(*at),
            position_m: matches!(joint.kind, JointKind::Slide).then_some(*at),
            force_n: *force,
        };
        BallGripFigures {
            hand: &hand.name,
            joints: joints.map(joint).collect(),
            touching: self.touching(),
            held_directions: self.holding_directions().len(),
            moved_mm: self.moved.iter().map(|(name, moved)| (*name, moved * 1e3)).collect(),
            notes: &hand.notes,
        }
    }

    /// Returns the results as text.
    pub fn table(&self) -> String {
        let hand = &self.hand;
        let mut text = format!("{}: {} joints, {} actuators\n", hand.name, hand.tree.len(), hand.actuators.len());
        text += &format!("{:40} {:>12} {:>12}\n", "joint", "deg or mm", "its link N");
        for (joint, (at, force)) in hand.tree.joints.iter().zip(self.closed.angles().iter().zip(&self.forces)) {
            let at = match joint.kind {
                JointKind::Turn => format!("{:.1} deg", at.to_degrees()),
                JointKind::Slide => format!("{:.2} mm", 1e3 * at),
            };
            text += &format!("{:40} {at:>12} {force:>12.2}\n", joint.name);
        }
        text += &format!(
            "{} links touch; held against gravity towards: {}\n",
            self.touching(),
            self.holding_directions().join(" ")
        );
        text
    }

    /// Draws the hand, open and closed, from two sides, into a PNG.
    pub fn draw(&self, path: &Path) -> Result<()> {
        let points: Vec<Point3<f64>> = [&self.open, &self.closed]
            .into_iter()
            .flat_map(|scene| self.model.triangles(&scene.links()))
            .flatten()
            .collect();
        let corner = |pick: fn(f64, f64) -> f64, start: f64| {
            points.iter().fold(Vector3::repeat(start), |so_far, point| so_far.zip_map(&point.coords, pick))
        };
        let (low, high) = (corner(f64::min, f64::INFINITY), corner(f64::max, f64::NEG_INFINITY));
        let center = Point3::from(0.5 * (low + high));
        let width = 1.05 * (high - low).norm();
        let mut pictures = Vec::new();
        for (eye, up) in [(Vector3::new(1.0, 0.6, 0.4), Vector3::z()), (Vector3::new(0.5, -1.0, 0.5), Vector3::z())] {
            for (scene, caption) in [(&self.open, "open"), (&self.closed, "closed on the ball")] {
                let mut picture = Picture::new(420, View { eye: eye.normalize(), up, center, width });
                for [a, b, c] in self.model.triangles(&scene.links()) {
                    let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-15) else { continue };
                    picture.triangles(&Isometry3::identity(), &[a, b, c], &[[0, 1, 2]], &[normal; 3], HAND_COLOR);
                }
                for pose in scene.objects() {
                    picture.prop(&self.ball, &pose, PROP_COLORS[0]);
                }
                pictures.push(picture.finish(caption));
            }
        }
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        }
        save(&tile(&pictures, 2), path)
    }
}
