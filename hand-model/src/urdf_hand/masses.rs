//! The mass of each moving link, including everything fixed to it.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use urdf_rs::Robot;

use crate::hand::MassProperties;
use crate::hand_mechanism::CollisionSolid;
use crate::kinematics::{Tree, pose_from_xyz_rpy};
use crate::urdf::urdf_error;
use ftac_platform::data::DataError;

/// Smallest ratio of the least to the largest principal moment: point masses on a line have less, up to rounding.
const MIN_MOMENT_RATIO: f64 = 1e-9;
/// Density assumed for a link without mass, over the bounding boxes of its collision shapes, kg/m3: half plastic, half
/// air.
const DEFAULT_DENSITY: f64 = 500.0;
/// Mass (kg) and radius (m) of the ball that replaces a link with neither mass nor shape.
const PLACEHOLDER_BALL: (f64, f64) = (1e-3, 5e-3);

/// Computes and checks the mass properties of each joint's link.
pub(crate) fn link_masses(
    robot: &Robot,
    tree: &Tree,
    carried: &BTreeMap<String, (Option<usize>, Isometry3<f64>)>,
    solids: &[CollisionSolid],
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<MassProperties>, DataError> {
    let mut masses = masses(robot, tree, carried, path, notes)?;
    for (n, mass) in masses.iter_mut().enumerate().filter(|(_, mass)| mass.mass <= 0.0) {
        *mass = estimate_mass(solids.iter().filter(|solid| solid.link == Some(n)));
        let (file, link, grams) = (path.display(), moved_link(robot, &tree.joints[n].name), 1e3 * mass.mass);
        notes.push(format!(
            "{file}: link[{link}].inertial.mass: none; taken as {grams:.1} g, {DEFAULT_DENSITY} kg/m3 over the boxes around its collision shapes"
        ));
    }
    check(robot, tree, &masses, path)?;
    Ok(masses)
}

/// Estimates the mass properties from the bounding boxes of `solids`.
fn estimate_mass<'a>(solids: impl Iterator<Item = &'a CollisionSolid>) -> MassProperties {
    let (mass, radius) = PLACEHOLDER_BALL;
    let ball =
        MassProperties { mass, com: Point3::origin(), inertia: Matrix3::identity() * (0.4 * mass * radius * radius) };
    let boxes = solids.map(|solid| {
        let (middle, half) = solid.shape.extent();
        let mass = DEFAULT_DENSITY * 8.0 * half.product();
        let square = half.component_mul(&half);
        let moments = Vector3::new(square.y + square.z, square.z + square.x, square.x + square.y) * (mass / 3.0);
        let turn = solid.link_from_solid.rotation.to_rotation_matrix();
        let inertia = turn * Matrix3::from_diagonal(&moments) * turn.transpose();
        MassProperties { mass, com: solid.link_from_solid * middle, inertia }
    });
    boxes.reduce(|a, b| combine_masses(&a, &b)).filter(|boxes| boxes.mass > PLACEHOLDER_BALL.0).unwrap_or(ball)
}

/// Returns the name of the link that a joint moves.
fn moved_link<'a>(robot: &'a Robot, joint: &str) -> &'a str {
    robot.joints.iter().find(|own| own.name == joint).map_or("", |own| &own.child.link)
}

/// Checks that every link that a joint moves has inertia, its own or that of what is fixed to it.
fn check(robot: &Robot, tree: &Tree, masses: &[MassProperties], path: &Path) -> Result<(), DataError> {
    for (joint, mass) in tree.joints.iter().zip(masses) {
        let element = format!("link[{}]", moved_link(robot, &joint.name));
        let moments = mass.inertia.symmetric_eigenvalues();
        if moments.min() <= MIN_MOMENT_RATIO * moments.max() {
            let found = format!("principal moments {:?}", [moments.x, moments.y, moments.z]);
            let expected =
                "a positive definite inertia in kg m2 on a link that a joint moves, or on what is fixed to it";
            return Err(urdf_error(path, element, "inertial.inertia", found, expected));
        }
    }
    Ok(())
}

fn masses(
    robot: &Robot,
    tree: &Tree,
    carried: &BTreeMap<String, (Option<usize>, Isometry3<f64>)>,
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<MassProperties>, DataError> {
    let nothing = MassProperties { mass: 0.0, com: Point3::origin(), inertia: Matrix3::zeros() };
    let mut masses = vec![nothing; tree.len()];
    for link in &robot.links {
        let Some((Some(carrier), pose)) = carried.get(&link.name) else { continue };
        let inertial = &link.inertial;
        let mass = inertial.mass.value;
        if mass <= 0.0 {
            // A frame without mass, fixed to a link that has some.
            continue;
        }
        let place = pose * pose_from_xyz_rpy(inertial.origin.xyz.0, inertial.origin.rpy.0);
        let i = &inertial.inertia;
        let turn = place.rotation.to_rotation_matrix();
        let inertia =
            turn * Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz) * turn.transpose();
        if inertia == Matrix3::zeros() {
            let (file, link) = (path.display(), &link.name);
            notes.push(format!("{file}: link[{link}].inertial: {mass} kg without inertia; taken as a point mass"));
        } else if inertia.symmetric_eigenvalues().min() <= 0.0 {
            let found = format!("{:?}", [i.ixx, i.iyy, i.izz]);
            let expected = "a positive definite inertia in kg m2";
            return Err(urdf_error(path, format!("link[{}]", link.name), "inertial.inertia", found, expected));
        }
        let at = place * Point3::origin();
        masses[*carrier] = combine_masses(&masses[*carrier], &MassProperties { mass, com: at, inertia });
    }
    Ok(masses)
}

/// Combines two bodies in the same frame.
fn combine_masses(a: &MassProperties, b: &MassProperties) -> MassProperties {
    let mass = a.mass + b.mass;
    let com = (a.com.coords * a.mass + b.com.coords * b.mass) / mass;
    let moved = |part: &MassProperties| {
        let d = part.com.coords - com;
        part.inertia + (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * part.mass
    };
    MassProperties { mass, com: com.into(), inertia: moved(a) + moved(b) }
}
