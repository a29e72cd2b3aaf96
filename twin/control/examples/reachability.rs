//! Prints which palm poses over the working area the arm can reach, and the lowest wrist height, for several pedestal
//! heights.
use control::inverse_kinematics::{ArmKinematics, ArmMount, ArmServo, IkSettings, Joints, PathRollout};
use control::trajectory::{PathLimits, PosePath};
use hand_model::{Arm, Hand};
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

const RADIUS: f64 = 0.045;

/// Height (m) of the lowest point of links 5 to 7, modelled as capsules.
fn lowest(kinematics: &ArmKinematics, q: &Joints) -> f64 {
    let links = kinematics.link_poses(q);
    let tool = links[6] * kinematics.arm().last_from_tool;
    let ends = [links[4], links[5], links[6], tool];
    ends.iter().map(|pose| pose.translation.z).fold(f64::INFINITY, f64::min) - RADIUS
}

/// Smallest distance (m) between the capsules of links 5 to 7 and the axis of the base below the shoulder, less both
/// radii.
fn base_gap(kinematics: &ArmKinematics, q: &Joints) -> f64 {
    let links = kinematics.link_poses(q);
    let top = kinematics.mount().world_from_base.translation.z + 0.30;
    let mut gap = f64::INFINITY;
    for pair in [links[4], links[5], links[6], links[6] * kinematics.arm().last_from_tool].windows(2) {
        for n in 0..=10 {
            let p = pair[0].translation.vector.lerp(&pair[1].translation.vector, f64::from(n) / 10.0);
            gap = gap.min(Vector3::new(p.x, p.y, (p.z - top).max(0.0)).norm() - 2.0 * RADIUS);
        }
    }
    gap
}

/// Predicts a motion from home: straight to 0.15 m above `goal`, then down to it, then at rest. `None` if the servo
/// does not arrive there.
fn walk(kinematics: &ArmKinematics, goal: &Isometry3<f64>, share: f64) -> Option<PathRollout> {
    let servo = ArmServo::new(kinematics.clone(), IkSettings::default(), Arm::gen3().home);
    let servo = servo.ok()?;
    let above = Isometry3::translation(0.0, 0.0, 0.15) * goal;
    let path = PosePath::fastest(&[servo.palm_pose(), above, *goal], PathLimits::default().scaled(share));
    let r = servo.roll_out(&path.ok()?, 1.0, 0.01).ok()?;
    (r.position_error < 1e-3 && r.rotation_error < 4e-3).then_some(r)
}

fn main() {
    let hand = Hand::ftac();
    let level = UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&[
        -Vector3::y(),
        Vector3::x(),
        Vector3::z(),
    ]));
    let pitch = |deg: f64| level * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -deg.to_radians());
    // Palm -x (ulnar edge) down: the palm turns about its y.
    let roll = |deg: f64, pitch_deg: f64| {
        level
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -pitch_deg.to_radians())
            * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -deg.to_radians())
    };
    let mut cases = vec![("level".to_string(), level)];
    for deg in [10.0, 20.0, 30.0, 40.0, 50.0] {
        cases.push((format!("pitched {deg}"), pitch(deg)));
    }
    for deg in [52.0, 99.0] {
        for p in [0.0, 30.0] {
            cases.push((format!("rolled {deg} pitched {p}"), roll(deg, p)));
        }
    }
    let heights: Vec<f64> =
        std::env::args().nth(1).map_or(vec![0.07], |h| h.split(',').filter_map(|h| h.parse().ok()).collect());
    // Share of the default path limits at which the servo is tried.
    let share = std::env::args().nth(2).and_then(|share| share.parse().ok()).unwrap_or(0.5);
    let xs = [0.40, 0.45, 0.50, 0.55, 0.60, 0.65];
    for z in heights {
        for pedestal in [0.0, 0.1, 0.2] {
            let kinematics = ArmKinematics::new(Arm::gen3(), ArmMount::for_hand(&hand, pedestal));
            println!(
                "palm at z = {z:.2} m, pedestal {pedestal:.1} m: reachable of 5 y per x (clear of table and base), lowest wrist point mm [worst of best]"
            );
            for (name, rotation) in &cases {
                let mut row = String::new();
                let (mut walked, mut held_back, mut lag, mut lowest_walked, mut missed) =
                    (0, 0, 0.0f64, f64::INFINITY, String::new());
                let (mut worst, mut total, mut clear_total) = (f64::INFINITY, 0, 0);
                for x in xs {
                    let (mut reached, mut clear) = (0, 0);
                    for y in [-0.25, -0.125, 0.0, 0.125, 0.25] {
                        let pose = Isometry3::from_parts(Translation3::new(x, y, z), *rotation);
                        let found = kinematics.solutions(&pose, &Arm::gen3().home);
                        if let Some(r) = walk(&kinematics, &pose, share) {
                            walked += 1;
                            lag = lag.max(r.worst_position_error);
                            held_back += usize::from(r.saturated_ticks > 0);
                            lowest_walked = lowest_walked.min(lowest(&kinematics, &r.q));
                        } else if !found.is_empty() {
                            missed += &format!(" ({x:.2}, {y})");
                        }
                        reached += usize::from(!found.is_empty());
                        let good: Vec<f64> = found
                            .iter()
                            .filter(|q| base_gap(&kinematics, q) > 0.0)
                            .map(|q| lowest(&kinematics, q))
                            .collect();
                        let best = good.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                        clear += usize::from(best > 0.0);
                        if best.is_finite() {
                            worst = worst.min(best);
                        }
                    }
                    total += reached;
                    clear_total += clear;
                    row += &format!(" {x:.2}:{reached}({clear})");
                }
                println!(
                    "  {name:<22}{row}  total {total}/30, clear {clear_total}/30, worst {:.0}; servo from home {walked}/30, held back in {held_back}, worst lag {:.1} mm, wrist {:.0}, missed{missed}",
                    worst * 1e3,
                    lag * 1e3,
                    lowest_walked * 1e3
                );
            }
        }
    }
}
