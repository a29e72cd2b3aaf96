//! In-hand pose with the hand's own kinematics: a quasi-static grasp is computed (springs, cables, Winkler contact),
//! noise is added to the readings of pads and servos, and the pose is estimated from a wrong plan.

mod shapes;

use hand_model::robot::ServoState;
use hand_model::{DigitVector, Hand};
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use shapes::{Ball, Block, Ellipsoid};
use tactile_perception::contacts::{ContactOptions, contact_free_points, find_contacts};
use tactile_perception::{
    IMAGE_SIZE as N, KnownShape, PIXELS, PadTouch, PoseEstimate, PoseInputs, PoseOptions, PosePrior, Readings,
    TouchError, estimate_pose,
};

struct Noise(u64);
impl Noise {
    fn normal(&mut self) -> f64 {
        (0..12)
            .map(|_| {
                self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (self.0 >> 11) as f64 / (1u64 << 53) as f64
            })
            .sum::<f64>()
            - 6.0
    }
    fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal()) * sigma
    }
}

/// Indentation of the gel by the object at a surface point of a pad, along the pad's normal, m.
fn indentation(shape: &dyn KnownShape, object_from_pad: &Isometry3<f64>, surface: &Point3<f64>) -> f64 {
    let mut depth = 0.0;
    for _ in 0..12 {
        let (distance, _) = shape.signed_distance(&(object_from_pad * (surface - Vector3::z() * depth)));
        if distance > -1e-6 || depth > 0.02 {
            break;
        }
        depth -= distance;
    }
    depth
}

/// Posture in which springs, cable tensions and contact balance, reached by winding up the cables slowly.
fn close(hand: &Hand, shape: &dyn KnownShape, pose: &Isometry3<f64>, tensions: &[f64], opposition: f64) -> [f64; 15] {
    let mut q = [0.0; 15];
    q[0] = opposition;
    let samples: Vec<_> = hand.pads.iter().map(|pad| (pad.surface_samples(10, 16), pad.h * pad.w / 160.0)).collect();
    let balance = |q: &[f64; 15], cable: usize, tension: f64| -> Vector3<f64> {
        let links = hand.tree.forward(q);
        let poses = hand.pad_poses(&links);
        let mut all = [0.0; 5];
        all[cable] = tension;
        let torques = hand.transmission.torques(q, &all);
        let mut residual = Vector3::new(torques[3 * cable], torques[3 * cable + 1], torques[3 * cable + 2]);
        for (index, pad) in
            hand.pads.iter().enumerate().filter(|(_, pad)| pad.link.is_some_and(|link| link / 3 == cable))
        {
            let object_from_pad = pose.inverse() * poses[index];
            for point in &samples[index].0 {
                let depth = indentation(shape, &object_from_pad, point);
                if depth > 0.0 {
                    let force = poses[index] * -Vector3::z() * depth * hand.gel().stiffness * samples[index].1;
                    let at = (poses[index] * point).coords;
                    for joint in hand.tree.chain(pad.link.expect("a link")) {
                        let axis = links[joint] * Vector3::z();
                        residual[joint % 3] += axis.dot(&(at - links[joint].translation.vector).cross(&force));
                    }
                }
            }
        }
        residual
    };
    for cable in 0..5 {
        let first = if cable == 0 { 1 } else { 0 };
        for step in 1..=60 {
            let tension = tensions[cable] * step as f64 / 60.0;
            let mut damping = 1e-3;
            for _ in 0..30 {
                let r = balance(&q, cable, tension);
                let mut jacobian = Matrix3::identity();
                for k in first..3 {
                    let mut moved = q;
                    moved[3 * cable + k] += 1e-5;
                    jacobian.set_column(k, &((balance(&moved, cable, tension) - r) / 1e-5));
                }
                let live = |v: Vector3<f64>| if first == 1 { Vector3::new(0.0, v.y, v.z) } else { v };
                if first == 1 {
                    jacobian.set_row(0, &Vector3::x().transpose());
                }
                let normal = jacobian.transpose() * jacobian + Matrix3::identity() * damping;
                let delta = -(normal.try_inverse().expect("invertible") * jacobian.transpose() * live(r));
                let mut candidate = q;
                (first..3).for_each(|k| {
                    candidate[3 * cable + k] = (q[3 * cable + k] + delta[k].clamp(-0.05, 0.05)).clamp(0.0, 1.57)
                });
                if live(balance(&candidate, cable, tension)).norm() < live(r).norm() {
                    q = candidate;
                    damping = f64::max(damping * 0.3, 1e-9);
                } else {
                    damping *= 8.0;
                }
                if live(r).norm() < 1e-5 {
                    break;
                }
            }
        }
    }
    q
}

/// Readings of pads and servos with noise: points 20 um, normals 3 deg, depths 10 % and a tilt, currents 3 %, cables
/// 0.2 mm.
fn feel(
    hand: &Hand,
    shape: &dyn KnownShape,
    pose: &Isometry3<f64>,
    q: &[f64; 15],
    tensions: &[f64],
    noise: &mut Noise,
) -> (Vec<PadTouch>, [ServoState; 6]) {
    let poses = hand.pad_poses(&hand.tree.forward(q));
    let mut touches: Vec<PadTouch> = (0..17).map(|pad| PadTouch { pad, ..PadTouch::default() }).collect();
    for (index, camera) in hand.cameras.iter().enumerate() {
        let pad = &hand.pads[camera.pad];
        let object_from_pad = pose.inverse() * poses[camera.pad];
        let (scale, tilt) = (1.0 + 0.1 * noise.normal(), 0.02 * noise.normal());
        let height: Vec<f32> = (0..PIXELS)
            .map(|i| {
                let (x, y) = camera.pixel_center(i % N, i / N);
                let h = indentation(shape, &object_from_pad, &Point3::new(x, y, pad.surface_height(x, y)));
                if h > 0.0 { (h * (scale + tilt * (x + y) / 0.01)) as f32 } else { 0.0 }
            })
            .collect();
        let patches = find_contacts(pad, index, camera, hand.gel(), &height, &ContactOptions::default());
        let touch = &mut touches[camera.pad];
        touch.contact_free.extend(contact_free_points(pad, camera, Some(&height), 4e-5, 4, 6));
        for mut patch in patches {
            for point in &mut patch.points {
                point.point.z += 2e-5 * noise.normal();
                point.normal = (point.normal + noise.vector(0.05)).normalize();
            }
            touch.force += patch.force;
            touch.patches.push(patch);
        }
    }
    let (radius, servo) = (hand.parameters.cable.spool_radius, hand.parameters.servo);
    let mut servos = [ServoState::default(); 6];
    for cable in 0..5 {
        let wound = hand.transmission.cables[cable].excursion(q) + tensions[cable] / hand.parameters.cable.stiffness;
        servos[cable].position = (wound + 2e-4 * noise.normal()) / radius;
        servos[cable].current = tensions[cable] * radius / servo.torque_constant * (1.0 + 0.03 * noise.normal());
    }
    servos[5].position = q[0] * servo.gear_ratio_opposition;
    (touches, servos)
}

/// Error of the position, mm, and of the rotation, degrees.
fn error(estimate: &Isometry3<f64>, truth: &Isometry3<f64>) -> (f64, f64) {
    (
        (estimate.translation.vector - truth.translation.vector).norm() * 1e3,
        estimate.rotation.angle_to(&truth.rotation).to_degrees(),
    )
}

fn at(x: f64, y: f64, z: f64, turn: [f64; 3]) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_scaled_axis(Vector3::from(turn)))
}

struct Case {
    name: &'static str,
    shape: Box<dyn KnownShape>,
    truth: Isometry3<f64>,
    tensions: DigitVector,
}

fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "ball",
            shape: Box::new(Ball(0.03)),
            truth: at(0.005, 0.0, -0.022, [0.0; 3]),
            tensions: [8.0, 9.0, 9.0, 9.0, 0.0].into(),
        },
        Case {
            name: "box",
            shape: Box::new(Block(Vector3::new(0.045, 0.022, 0.018))),
            truth: at(0.0, 0.008, -0.006, [0.05, 0.08, 0.1]),
            tensions: [8.0, 9.0, 9.0, 9.0, 9.0].into(),
        },
        Case {
            name: "ellipsoid",
            shape: Box::new(Ellipsoid(Vector3::new(0.042, 0.025, 0.02))),
            truth: at(0.002, 0.004, -0.01, [0.1, -0.1, 0.2]),
            tensions: [8.0, 9.0, 9.0, 9.0, 9.0].into(),
        },
    ]
}

/// Estimates the pose with default options except for `use_contact_free`.
fn estimate(
    hand: &Hand,
    (touches, servos): (&[PadTouch], &[ServoState; 6]),
    prior: &PosePrior,
    shape: &dyn KnownShape,
    use_clear: bool,
) -> Result<PoseEstimate, TouchError> {
    let options = &PoseOptions { use_contact_free: use_clear, ..PoseOptions::default() };
    estimate_pose(&PoseInputs { hand, touches, readings: Readings::without_gravity(servos), prior, shape, options })
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn describe(hand: &Hand, touches: &[PadTouch]) -> String {
    touches.iter().filter(|t| t.is_touched()).map(|t| format!("{} {:.1} N, ", hand.pads[t.pad].name, t.force)).collect()
}

#[test]
fn poses_are_recovered_from_wrong_plans() {
    let hand = Hand::ftac();
    let mut noise = Noise(3);
    for case in cases() {
        let shape = &*case.shape;
        let q = close(&hand, shape, &case.truth, &case.tensions, 1.2);
        let (mut before, mut after) = ((vec![], vec![]), (vec![], vec![]));
        let (mut joints, mut normalised, mut along) = (vec![], vec![], vec![]);
        let mut last: Option<PoseEstimate> = None;
        for trial in 0..12 {
            let (touches, servos) = feel(&hand, shape, &case.truth, &q, &case.tensions, &mut noise);
            if trial == 0 {
                println!("{}: {}", case.name, describe(&hand, &touches));
            }
            let plan = Isometry3::from_parts(
                Translation3::from(case.truth.translation.vector + noise.vector(0.009)),
                UnitQuaternion::new(noise.vector(0.2)) * case.truth.rotation,
            );
            let found = estimate(&hand, (&touches, &servos), &PosePrior::weak(plan), shape, true).expect("a pose");
            let (a, b) = (error(&plan, &case.truth), error(&found.palm_from_object, &case.truth));
            // Contacts on a box's long faces do not constrain its position along them: that error is counted separately.
            let offset = case
                .truth
                .inverse_transform_vector(&(found.palm_from_object.translation.vector - case.truth.translation.vector));
            along.push(offset.x.abs() * 1e3);
            let b = if case.name == "box" { (offset.y.hypot(offset.z) * 1e3, b.1) } else { b };
            before.0.push(a.0);
            before.1.push(a.1);
            after.0.push(b.0);
            after.1.push(b.1);
            normalised.push(b.0 / 1e3 / (3f64.sqrt() * found.sigma().0));
            for digit in 0..5 {
                if touches.iter().any(|t| t.is_touched() && hand.pads[t.pad].link.is_some_and(|link| link / 3 == digit))
                {
                    joints.extend((0..3).map(|k| (found.q[3 * digit + k] - q[3 * digit + k]).abs().to_degrees()));
                }
            }
            last = Some(found);
        }
        let last = last.expect("an estimate");
        let worst = after.0.iter().copied().fold(0.0, f64::max);
        let (b_mm, b_deg, a_mm, a_deg) =
            (median(&mut before.0), median(&mut before.1), median(&mut after.0), median(&mut after.1));
        println!(
            "{}: (along x {:.1} mm) plan {b_mm:.1} mm {b_deg:.1} deg -> touch {a_mm:.2} mm (worst {worst:.2}) {a_deg:.1} deg; joints {:.2} deg; error/sigma {:.2}; {} steps; rms {:.2} mm; unobservable {}",
            case.name,
            median(&mut along),
            median(&mut joints),
            median(&mut normalised),
            last.steps,
            last.residual_rms * 1e3,
            last.unobservable.len(),
        );
        // A ball's orientation is unobservable, a box's is not; an ellipsoid's depends on the noise.
        match case.name {
            "ball" => assert_eq!(last.unobservable.len(), 3),
            "box" => assert_eq!(last.unobservable.len(), 0),
            _ => {}
        }
        let name = case.name;
        assert!(name == "ball" || a_deg < 0.5 * b_deg, "{name}: {b_deg} to {a_deg} deg");
        assert!(a_mm < 0.3 * b_mm && a_mm < 4.0, "{name}: {b_mm} to {a_mm} mm");
    }
}

/// With the object 20 mm off the plan, the estimate follows the contacts.
#[test]
fn follows_the_touch_not_the_plan() {
    let hand = Hand::ftac();
    let mut noise = Noise(11);
    let case = &cases()[0];
    let plan = at(-0.012, 0.010, -0.022, [0.0; 3]);
    let q = close(&hand, &*case.shape, &case.truth, &case.tensions, 1.2);
    let (touches, servos) = feel(&hand, &*case.shape, &case.truth, &q, &case.tensions, &mut noise);
    let found = estimate(&hand, (&touches, &servos), &PosePrior::weak(plan), &*case.shape, true).expect("a pose");
    let (to_truth, to_plan) = (error(&found.palm_from_object, &case.truth).0, error(&found.palm_from_object, &plan).0);
    println!(
        "off plan by {:.1} mm: {to_truth:.2} mm from the truth, {to_plan:.2} mm from the plan",
        error(&plan, &case.truth).0
    );
    assert!(to_truth < 3.0 && to_plan > 14.0, "{to_truth} {to_plan}");
}

/// A long box lies flat on the palm and reaches beyond the wrist; half-closed fingers in front of it feel nothing. The
/// felt points do not constrain it along its length, and the plan has it among the fingers. Only the untouched pads
/// contradict that.
#[test]
fn untouched_pads_matter() {
    let hand = Hand::ftac();
    let mut noise = Noise(5);
    let shape = Block(Vector3::new(0.015, 0.05, 0.012));
    let truth = at(-0.022, -0.09, 0.004, [0.0; 3]);
    let tensions = [0.0, 7.0, 7.0, 7.0, 7.0];
    let q = close(&hand, &shape, &truth, &tensions, 0.2);
    let (mut with, mut without, trials) = (0.0, 0.0, 12);
    for trial in 0..trials {
        let (touches, servos) = feel(&hand, &shape, &truth, &q, &tensions, &mut noise);
        if trial == 0 {
            println!("on the palm: {}", describe(&hand, &touches));
        }
        let plan = Isometry3::from_parts(
            Translation3::from(truth.translation.vector + Vector3::new(0.0, 0.03, -0.003) + noise.vector(0.003)),
            UnitQuaternion::new(noise.vector(0.1)),
        );
        for (use_clear, sum) in [(true, &mut with), (false, &mut without)] {
            let prior = PosePrior::weak(plan);
            let found = estimate(&hand, (&touches, &servos), &prior, &shape, use_clear).expect("a pose");
            *sum += error(&found.palm_from_object, &truth).0 / trials as f64;
        }
    }
    println!("untouched pads used: {with:.2} mm, ignored: {without:.2} mm");
    assert!(with < 0.85 * without);
}

/// If the pad with the largest force goes blind, the estimate stays close and its standard deviation grows.
#[test]
fn a_blind_pad_lowers_the_confidence() {
    let hand = Hand::ftac();
    let case = &cases()[2];
    let q = close(&hand, &*case.shape, &case.truth, &case.tensions, 1.2);
    let (mut touches, servos) = feel(&hand, &*case.shape, &case.truth, &q, &case.tensions, &mut Noise(21));
    let prior = PosePrior::weak(case.truth * at(0.004, -0.003, 0.002, [0.0, 0.1, 0.0]));
    let estimated =
        |touches: &[PadTouch]| estimate(&hand, (touches, &servos), &prior, &*case.shape, true).expect("a pose");
    let all = estimated(&touches);
    let strongest = touches.iter_mut().max_by(|a, b| a.force.total_cmp(&b.force)).expect("a touch");
    *strongest = PadTouch { pad: strongest.pad, blind: true, ..PadTouch::default() };
    let fewer = estimated(&touches);
    assert_eq!(fewer.blind, 1);
    assert!(fewer.sigma().0 > 1.02 * all.sigma().0, "{:?} {:?}", fewer.sigma(), all.sigma());
    let off = error(&fewer.palm_from_object, &case.truth).0;
    assert!(off < 6.0, "{off} mm");
}

/// The starts are searched in parallel; the result does not depend on the number of threads.
#[test]
fn threads_change_no_bit() {
    let hand = Hand::ftac();
    let case = &cases()[1];
    let q = close(&hand, &*case.shape, &case.truth, &case.tensions, 1.2);
    let (touches, servos) = feel(&hand, &*case.shape, &case.truth, &q, &case.tensions, &mut Noise(3));
    let prior = PosePrior::weak(case.truth * at(0.006, -0.004, 0.003, [0.1, 0.2, -0.1]));
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| estimate(&hand, (&touches, &servos), &prior, &*case.shape, true)).expect("a pose")
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn bad_input_is_named() {
    let hand = Hand::ftac();
    let mut servos = [ServoState::default(); 6];
    servos[2].current = f64::NAN;
    let prior = PosePrior::weak(Isometry3::identity());
    let error = estimate(&hand, (&[], &servos), &prior, &Ball(0.02), true).expect_err("not a number");
    assert_eq!(error.to_string(), "a servo reading is not finite");
}
