//! Writes grasps to a file, reads them back and classifies them.
//!
//! `cargo run -p dexterous-grasping --example grasp_file`
//!
//! The grasp is one that a robot or a physics engine held: pose of the object, joint angles, contacts. Here it is made
//! up: a bar that hangs on four bent fingers.

use dexterous_grasping::force_closure::{FrictionContact, wrench_margin};
use dexterous_grasping::synthesis::grasp_file::{self, GraspFileHeader, GraspWriter};
use dexterous_grasping::synthesis::held::{ClosedPose, DigitUse, HeldContact, HeldGrasp, pose_to_array};
use dexterous_grasping::taxonomy::Taxonomy;
use dexterous_grasping::taxonomy::attributes::{Attributes, FORM_POINTS, ObjectForm};
use dexterous_grasping::taxonomy::rules::TypeRules;
use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};

/// Radius of the bar and half of its length, m.
const BAR: (f64, f64) = (0.012, 0.1);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let hand = Hand::ftac();
    let path = std::env::temp_dir().join(format!("grasps-{}.jsonl", std::process::id()));
    let mut writer = GraspWriter::create(&path, &GraspFileHeader::new("example grasp_file".into(), 0))?;
    writer.add(&carried_bar(&hand)?)?;
    drop(writer);

    let (header, grasps) = grasp_file::read(&path)?;
    println!("{}: {} grasp(s), written by `{}`", path.display(), grasps.len(), header.command);
    std::fs::remove_file(&path)?;

    let taxonomy = Taxonomy::paper();
    let rules = TypeRules::builtin(&taxonomy);
    let form = ObjectForm::from_points(&bar_points());
    for grasp in &grasps {
        let attributes = Attributes::measure(&hand, &form, grasp);
        let decision = rules.decide(&taxonomy, &attributes);
        let kind = &taxonomy.types[decision.kind];
        println!("{}: {} ({}), margin {:.2}", grasp.object, kind.name, kind.category.name(), decision.margin);
        for condition in rules.explain(decision.kind, &attributes) {
            println!("  {} = {:.2}, {}: {}", condition.attribute, condition.value, condition.bounds, condition.reason);
        }
    }
    Ok(())
}

/// A bar along x that lies in four bent fingers. Each finger touches it from below and from the side of its tip.
fn carried_bar(hand: &Hand) -> Result<HeldGrasp, Box<dyn std::error::Error>> {
    let fingers = [Digit::Index, Digit::Middle, Digit::Ring, Digit::Little];
    let mut joints = vec![0.0; hand.tree.len()];
    for finger in fingers {
        hand.links(finger).iter().for_each(|&joint| joints[joint] = 1.0);
    }
    let center = Vector3::new(0.0, 0.02, -0.04);
    let mut contacts = Vec::new();
    for finger in fingers {
        let links = hand.links(finger);
        let across = hand.tree.joints[links[0]].origin.translation.x;
        // The normal points into the object.
        for (link, normal) in [(links[1], Vector3::new(0.0, 0.0, 1.0)), (links[2], Vector3::new(0.0, -1.0, 0.0))] {
            let point = Vector3::new(across, center.y, center.z) - BAR.0 * normal;
            contacts.push(HeldContact { link: Some(link), point: point.into(), normal: normal.into(), force: 1.5 });
        }
    }
    let rows = contacts.iter().map(|contact| FrictionContact {
        point: Point3::from(contact.point),
        normal: UnitVector3::new_normalize(Vector3::from(contact.normal)),
        friction: 0.8,
    });
    let margin = wrench_margin(&rows.collect::<Vec<_>>(), &Point3::from(center), BAR.1, 10.0)?;
    let palm_from_object = Isometry3::translation(center.x, center.y, center.z);
    let tension = |digit: &Digit| if fingers.contains(digit) { 15.0 } else { 0.0 };
    Ok(HeldGrasp {
        object: "bar".into(),
        chain: 0,
        closed: ClosedPose::PalmFromObject(pose_to_array(&palm_from_object)),
        joints: joints.into_iter().collect(),
        start: pose_to_array(&palm_from_object),
        open_joints: hand.open_angles().into_iter().collect(),
        open_tensions: None,
        tensions: hand.digits().iter().map(tension).collect(),
        opposition: Some(0.0),
        contacts,
        digit_use: Some(DigitUse { digits: fingers.into(), palm: false, approach: [0.0, 0.0, -1.0], room: None }),
        margin,
        penetration: 0.0,
        held_without_tension: None,
        moved: None,
        energy: None,
        verified_load: None,
    })
}

/// Points on the surface of the bar, along x, object frame.
fn bar_points() -> Vec<Point3<f64>> {
    let turn = |n: usize| (n as f64 * 2.4).sin_cos();
    let along = |n: usize| BAR.1 * (2.0 * n as f64 / FORM_POINTS as f64 - 1.0);
    (0..FORM_POINTS).map(|n| Point3::new(along(n), BAR.0 * turn(n).0, BAR.0 * turn(n).1)).collect()
}
