//! From a sampled posture of any hand to a closed grasp, moved by nothing but its own actuators, and the checks on it.

use anyhow::Result;
use grasping::force_closure::{Contact, soft_wrench_margin};
use grasping::synthesis::chain::Sample;
use grasping::synthesis::field::DistanceField;
use grasping::synthesis::frames::{Frames, HandState};
use nalgebra::{Isometry3, Vector3};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use sim::hand_scene::{HandScene, Pull, Touch, displacement};
use sim::stand::Prop;

use super::describe::Described;
use crate::synthesis::checks::{self, Pulling};
use crate::synthesis::closing::{DAMPING, NotClosed, OFFSET, RISE, SETTLE_DAMPED, SETTLE_FREE, pushed_away};
use crate::synthesis::subject::Subject;

/// Range of an actuator's tension, N, and the plain one.
const TENSIONS: (f64, f64) = (8.0, 60.0);
const CLOSE_TENSION: f64 = 30.0;
/// A link opens until it is this clear of the object, m.
const CLEAR: f64 = 1.5e-3;
/// Arm of the friction that a fingertip bears about its normal, m: 3 pi / 16 of the radius of its contact (Hertz), which is 5 mm for soft tips.
const TORSION_ARM: f64 = 3.0 * std::f64::consts::PI / 16.0 * 5e-3;
/// Torques count as forces at this arm, m: as far beside its middle as an object's weight may act.
const TORQUE_ARM: f64 = 0.01;
/// How far one step opens an actuator, rad, and how many steps and retreats there are at most.
const OPENING: f64 = 0.06;
const MOST_STEPS: usize = 60;

/// A closed grasp of any hand, at rest.
#[derive(Clone)]
pub struct AnyClosed {
    /// At rest; cloned for every test.
    pub stand: HandScene,
    /// N, one an actuator.
    pub tensions: Vec<f64>,
    /// Where it started.
    pub open: AnyOpen,
    /// What touches, root frame.
    pub touches: Vec<Touch>,
}

impl Pulling for AnyClosed {
    fn dt(&self) -> f64 {
        self.stand.dt()
    }

    fn object(&self) -> Isometry3<f64> {
        self.stand.object()
    }

    fn joints(&self) -> &[f64] {
        self.stand.angles()
    }

    fn step(&mut self, force: &Vector3<f64>) {
        self.stand.step(&Pull::tensions(&self.tensions), force);
    }
}

/// An open hand before an object.
#[derive(Clone)]
pub struct AnyOpen {
    /// `root_from_object`.
    pub start: Isometry3<f64>,
    /// Angle of every joint, rad.
    pub joints: Vec<f64>,
    /// Tensions that hold it, N.
    pub tensions: Vec<f64>,
}

/// Tensions and an offset of the hand.
pub struct AnyAim {
    tensions: Vec<f64>,
    offset: [f64; 6],
}

impl AnyAim {
    /// Every actuator alike, where the sample is.
    pub fn plain(actuators: usize) -> Self {
        Self { tensions: vec![CLOSE_TENSION; actuators], offset: [0.0; 6] }
    }

    /// Random tensions, a small offset.
    pub fn varied(actuators: usize, rng: &mut impl Rng) -> Self {
        let draw = |rng: &mut _| TENSIONS.0 * (TENSIONS.1 / TENSIONS.0).powf(RngExt::random::<f64>(rng));
        let tensions = (0..actuators).map(|_| draw(rng)).collect();
        Self {
            tensions,
            offset: std::array::from_fn(
                |n| if n < 3 { OFFSET.0 } else { OFFSET.1 } * rng.sample::<f64, _>(StandardNormal),
            ),
        }
    }
}

/// Projects a sample onto the actuators' lines and opens it until it is clear of the object; the amounts on the lines as well.
fn open_clear(
    hand: &Described,
    field: &DistanceField,
    frames: &mut Frames,
    sample: &HandState,
) -> Option<(HandState, Vec<f64>)> {
    let mechanism = &hand.mechanism;
    let mut state = sample.clone();
    let mut amounts: Vec<f64> = (0..mechanism.lines.len()).map(|line| mechanism.amount(line, &state.joints)).collect();
    let start: Vec<f64> =
        state.joints.iter().zip(&mechanism.limits).map(|(q, (low, high))| q.clamp(*low, *high)).collect();
    state.joints = start;
    for _ in 0..MOST_STEPS {
        for (line, amount) in amounts.iter().enumerate() {
            mechanism.set_amount(line, *amount, &mut state.joints);
        }
        frames.place(&state);
        let mut clear = true;
        for (link, surface) in hand.surface.links.iter().enumerate() {
            let mut least = (f64::INFINITY, Vector3::zeros());
            for local in &surface.points {
                let x = frames.point(link, local);
                let distance = field.distance(&x);
                if distance < least.0 {
                    least = (distance, x);
                }
            }
            let movers: Vec<usize> = (0..amounts.len()).filter(|line| moves(hand, *line, link)).collect();
            let can_open = movers.iter().any(|line| amounts[*line] > 0.0);
            if least.0 < 0.0 && !can_open {
                state.object_from_palm.translation.vector += field.at(&least.1).normal * (0.3e-3 - least.0);
                clear = false;
            } else if least.0 < CLEAR && can_open {
                let step = |line: usize| OPENING * mechanism.unit(line);
                movers.iter().for_each(|line| amounts[*line] = (amounts[*line] - step(*line)).max(0.0));
                clear = false;
            }
        }
        if clear {
            return Some((state, amounts));
        }
    }
    None
}

/// Whether an actuator moves a link (0 is the root).
fn moves(hand: &Described, line: usize, link: usize) -> bool {
    link > 0 && hand.tree.chain(link - 1).iter().any(|joint| hand.mechanism.lines[line].joints.contains(joint))
}

/// The tension that holds an actuator `amount` along its line, free of contact, N.
fn holding(hand: &Described, line: usize, amount: f64) -> f64 {
    let arms = &hand.hand.pulls[line].arms;
    let (joint, arm) = arms[0];
    let own = &hand.mechanism.lines[line];
    let share = own.joints.iter().position(|own| *own == joint).map_or(1.0, |n| own.share[n]);
    (hand.hand.feel(joint).spring * amount * share / arm).max(0.0)
}

/// Closes a sample.
pub fn close(
    hand: &Described,
    subject: &Subject,
    sample: &Sample,
    frames: &mut Frames,
    aim: &AnyAim,
) -> Result<AnyClosed, NotClosed> {
    let mut by = vec![0.0; sample.state.freedom()];
    by[..6].copy_from_slice(&aim.offset);
    let (state, amounts) =
        open_clear(hand, &subject.field, frames, &sample.state.moved(&by)).ok_or(NotClosed::Blocked)?;
    let start = hand.palm_from_root.inverse() * state.object_from_palm.inverse();
    let tensions = amounts.iter().enumerate().map(|(line, amount)| holding(hand, line, *amount)).collect();
    // No joint bears more than its effort.
    let (after, _) = hand.hand.within_efforts(&aim.tensions);
    pull(hand, subject, AnyOpen { start, joints: state.joints, tensions }, &after)
}

/// Closes an open hand: its tensions rise to `after` (N).
pub fn pull(hand: &Described, subject: &Subject, open: AnyOpen, after: &[f64]) -> Result<AnyClosed, NotClosed> {
    let AnyOpen { start, joints, tensions: before } = &open;
    let mut stand = HandScene::of_urdf(&hand.body, joints);
    let model = &subject.model;
    stand.put(&Prop::new(&model.name, model.shape.clone(), model.mass, model.friction), start);
    stand.release();
    stand.set_object_damping(DAMPING);
    let steps = |time: f64| (time / stand.dt()).round() as usize;
    let (rise, damped, free) = (steps(RISE), steps(SETTLE_DAMPED), steps(SETTLE_FREE));
    for step in 0..rise + damped + free {
        let part = (step as f64 / rise as f64).min(1.0);
        let tensions: Vec<f64> = before.iter().zip(after).map(|(a, b)| a + part * (b - a)).collect();
        if step == rise + damped {
            stand.set_object_damping(0.0);
        }
        stand.step(&Pull { tensions, opposition: 0.0 }, &Vector3::zeros());
        if step % 24 == 0 && pushed_away(displacement(start, &stand.object())) {
            return Err(NotClosed::PushedAway);
        }
    }
    if pushed_away(displacement(start, &stand.object())) {
        return Err(NotClosed::PushedAway);
    }
    let touches = stand.touches();
    Ok(AnyClosed { stand, tensions: after.to_vec(), open, touches })
}

/// Wrench margin of soft contacts, N, torques over [`TORQUE_ARM`].
pub fn margin(subject: &Subject, closed: &AnyClosed) -> Result<f64> {
    let contact =
        |touch: &Touch| Contact { point: touch.point, normal: touch.normal, friction: subject.model.friction };
    let contacts: Vec<Contact> = closed.touches.iter().map(contact).collect();
    let center = closed.stand.object() * subject.field.center;
    Ok(soft_wrench_margin(&contacts, TORSION_ARM, &center, TORQUE_ARM, checks::TOTAL_FORCE)?)
}
