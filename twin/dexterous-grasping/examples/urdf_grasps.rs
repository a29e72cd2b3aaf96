//! Searches grasps of a bottle with a hand from a URDF and ranks them by the wrench that they resist.
//!
//! `cargo run --release -p dexterous-grasping --example urdf_grasps [-- HAND.urdf ACTUATORS.toml]`
//!
//! Without files it uses a hand of three fingers and a thumb in the proportions of an Allegro Hand. The actuator file is
//! described in `hand_model::urdf_hand`; its `[palm] facing` is needed. Collision shapes of files must be boxes, spheres
//! or cylinders: a mesh needs a reader, which the caller supplies in `MeshTools`.

use std::path::Path;

use dexterous_grasping::force_closure::wrench_margin;
use dexterous_grasping::synthesis::chain::{self, AnnealingSchedule};
use dexterous_grasping::synthesis::energy::EnergyWeights;
use dexterous_grasping::synthesis::field::{DistanceField, FieldError};
use dexterous_grasping::synthesis::frames::PIVOT;
use dexterous_grasping::synthesis::mechanism::Mechanism;
use dexterous_grasping::synthesis::sampled_hand::SampledHand;
use dexterous_grasping::synthesis::surface::ContactCandidate;
use ftac_platform::data::DataError;
use hand_model::hand_mechanism::{HandMechanism, Triangles};
use hand_model::urdf_hand::{ConvexDecomposition, MeshTools};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

type Error = Box<dyn std::error::Error>;

const CHAINS: u64 = 8;
const CONTACTS: usize = 4;
/// A sample with a contact point farther from the object is no grasp, m.
const MAX_CONTACT_DISTANCE: f64 = 0.01;

fn main() -> Result<(), Error> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let meshes = MeshTools {
        read: |path| Err(DataError::field(path, "mesh", "a mesh", "a box, a sphere or a cylinder")),
        decompose: |_: &Triangles| ConvexDecomposition::default(),
    };
    let hand = match &files[..] {
        [urdf, actuators] => HandMechanism::read(Path::new(urdf), Path::new(actuators), meshes)?,
        [] => HandMechanism::parse(&urdf(), Path::new("hand.urdf"), ACTUATORS, Path::new("hand.toml"), meshes)?,
        _ => return Err("expected a URDF and an actuator file, or nothing".into()),
    };
    let sampled = sampled_hand(&hand)?;
    let candidates = sampled.surface.candidates.len();
    println!(
        "{}: {} joints, {} points, {candidates} contact candidates",
        hand.name,
        hand.tree.len(),
        sampled.surface.len()
    );

    let bottle = bottle(0.03, 0.06)?;
    let energy = sampled.energy(&bottle, EnergyWeights::default(), None);
    let mut frames = sampled.frames();
    let mut found = Vec::new();
    for number in 0..CHAINS {
        let mut rng = chain::chain_rng(1, number);
        let best = chain::run(&energy, &mut frames, CONTACTS, &AnnealingSchedule::default(), &mut rng).best;
        if best.terms.max_contact_distance > MAX_CONTACT_DISTANCE {
            continue;
        }
        let Some(contacts) = sampled.friction_contacts(&best, &bottle, 0.8) else { continue };
        // With all normal forces together at most 10 N.
        found.push((wrench_margin(&contacts, &bottle.center, bottle.length, 10.0)?, number, best));
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!("{} of {CHAINS} chains ended in a grasp", found.len());
    for (margin, number, best) in found {
        let terms = best.terms;
        println!(
            "chain {number}: margin {margin:5.2} N, energy {:6.2}, contacts within {:4.1} mm, deepest point {:4.1} mm",
            terms.total,
            1e3 * terms.max_contact_distance,
            1e3 * terms.max_depth
        );
    }
    Ok(())
}

/// A cylinder with round ends, its axis along z, by signed distance and outward normal.
fn bottle(radius: f64, half: f64) -> Result<DistanceField, FieldError> {
    let corner = Point3::new(radius, radius, half + radius);
    DistanceField::sample(&-corner, &corner, &Point3::origin(), 0.003, 0.03, |p| {
        let out = p.coords - Vector3::new(0.0, 0.0, p.z.clamp(-half, half));
        (out.norm() - radius, out.try_normalize(1e-9).unwrap_or_else(Vector3::x))
    })
}

/// Lays the hand out for sampling: the point on which the half-closed fingertips close is the pivot, and the palm faces
/// -z. A point that faces this pivot is a contact candidate.
fn sampled_hand(hand: &HandMechanism) -> Result<SampledHand, Error> {
    let facing = hand.palm.facing.ok_or("palm.facing: found none, expected the direction out of the palm")?;
    let mut joints = hand.rest_coordinates();
    let mechanism = Mechanism::from_urdf(hand);
    for line in &mechanism.lines {
        for (&joint, share) in line.joints.iter().zip(&line.share) {
            let (lower, upper) = mechanism.limits[joint];
            joints[joint] = 0.5 * (joints[joint] + if *share > 0.0 { upper } else { lower });
        }
    }
    let links = hand.tree.forward(&joints);
    let is_last = |link: &usize| !hand.tree.joints.iter().any(|joint| joint.parent == Some(*link));
    let tips: Vec<Point3<f64>> =
        (0..links.len()).filter(is_last).map(|link| links[link] * hand.masses[link].com).collect();
    let closing_point = tips.iter().map(|tip| tip.coords).sum::<Vector3<f64>>() / tips.len() as f64;
    let turn = UnitQuaternion::rotation_between(&facing, &-Vector3::z())
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let palm_from_root = Isometry3::from_parts(Translation3::from(PIVOT - turn * closing_point), turn);
    let faces_pivot = |at: &ContactCandidate| {
        let palm_from_link = if at.link == 0 { Isometry3::identity() } else { palm_from_root * links[at.link - 1] };
        let way = PIVOT - (palm_from_link * Point3::from(at.point)).coords;
        (palm_from_link * at.normal).dot(&way) > 0.7 * way.norm()
    };
    Ok(SampledHand::from_urdf(hand, &palm_from_root, 1500, faces_pivot))
}

const ACTUATORS: &str = r#"
version = 1
damping = 0.02
armature = 1e-4
spring = 0.02
[[actuator]]
name = "index"
arms = { index_1 = 0.010, index_2 = 0.008, index_3 = 0.006 }
[[actuator]]
name = "middle"
arms = { middle_1 = 0.010, middle_2 = 0.008, middle_3 = 0.006 }
[[actuator]]
name = "ring"
arms = { ring_1 = 0.010, ring_2 = 0.008, ring_3 = 0.006 }
[[actuator]]
name = "thumb"
arms = { thumb_1 = 0.010, thumb_2 = 0.008, thumb_3 = 0.006 }
[palm]
facing = [0, 0, -1]
"#;

/// Three fingers along y, side by side at the end of the palm, and a thumb that bends towards them from its other end.
/// Each digit has three joints and links of 45 mm.
fn urdf() -> String {
    let mut text = String::from(
        r#"<robot name="four_digits"><link name="palm"><collision><geometry><box size="0.1 0.1 0.03"/></geometry>
        </collision></link>"#,
    );
    for (digit, origin, yaw) in [
        ("index", "0.04 0.05 0", 0.0),
        ("middle", "0 0.05 0", 0.0),
        ("ring", "-0.04 0.05 0", 0.0),
        ("thumb", "0 -0.05 -0.02", std::f64::consts::PI),
    ] {
        for n in 1..=3 {
            let (parent, place) = match n {
                1 => ("palm".to_owned(), format!(r#"xyz="{origin}" rpy="0 0 {yaw}""#)),
                _ => (format!("{digit}_link_{}", n - 1), r#"xyz="0 0.045 0""#.to_owned()),
            };
            text += &format!(
                r#"<link name="{digit}_link_{n}"><inertial><origin xyz="0 0.0225 0"/><mass value="0.04"/>
                <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial><collision>
                <origin xyz="0 0.0225 0"/><geometry><box size="0.02 0.043 0.02"/></geometry></collision></link>
                <joint name="{digit}_{n}" type="revolute"><parent link="{parent}"/><child link="{digit}_link_{n}"/>
                <origin {place}/><axis xyz="-1 0 0"/><limit lower="-0.1" upper="1.6" effort="2" velocity="6"/></joint>"#
            );
        }
    }
    text + "</robot>"
}
