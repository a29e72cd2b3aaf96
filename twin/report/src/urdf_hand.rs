//! Grasps of a hand from a URDF: as a picture sheet, and as they are shown in a recording.

use std::path::Path;

use anyhow::Result;
use grasping::synthesis::held::pose_from_array;
use grasping::synthesis::kind::Kind;
use image::RgbImage;
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use proving::synthesis::grasping_hand::GraspingHand as _;
use proving::synthesis::subject::verified_for;
use proving::synthesis::urdf_hand::describe::Described;
use stream::gallery::{ShownContact, ShownGrasp, ShownHand};
use stream::mesh::Mesh;
use world::objects::ObjectModel;

use crate::picture::{Picture, View, save, tile};

/// Side of a picture, pixels.
const SIZE: u32 = 260;
/// Width of a picture as a multiple of the diagonal of what is drawn.
const MARGIN: f64 = 0.95;
/// Characters of a caption's line.
const LINE: usize = 30;
/// Colours of the hand and of contact points.
const STEEL: [f64; 3] = [176.0, 182.0, 192.0];
pub const CONTACT: [f64; 3] = [200.0, 30.0, 60.0];
/// Radius of a contact point, m.
pub const DOT: f64 = 2.5e-3;

/// The hand's collision shapes at joint angles (rad), three points a triangle, palm frame.
pub fn skin(hand: &Described, joints: &[f64]) -> Vec<[Point3<f64>; 3]> {
    let links = hand.hand.tree.forward(joints);
    hand.body.triangles(&links).into_iter().map(|triangle| triangle.map(|point| hand.palm_from_root * point)).collect()
}

/// Draws the hand's triangles.
pub fn draw(picture: &mut Picture, skin: &[[Point3<f64>; 3]]) {
    for [a, b, c] in skin {
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-15) else { continue };
        picture.triangles(&Isometry3::identity(), &[*a, *b, *c], &[[0, 1, 2]], &[normal; 3], STEEL);
    }
}

/// A sheet of the kinds of one object: a row a kind, seen onto the palm, from the side and along the fingers.
pub fn sheet(hand: &Described, model: &ObjectModel, kinds: &[Kind<'_>], path: &Path) -> Result<()> {
    let views = [View::palm(), View::thumb_side(), View::tips()];
    let pictures: Vec<RgbImage> =
        kinds.iter().flat_map(|kind| views.map(|view| picture(hand, model, kind, view))).collect();
    save(&tile(&pictures, views.len()), path)
}

fn picture(hand: &Described, model: &ObjectModel, kind: &Kind<'_>, view: View) -> RgbImage {
    let best = kind.best;
    let skin = skin(hand, &best.joints);
    let (low, high) = skin
        .iter()
        .flatten()
        .fold((Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)), |(low, high), point| {
            (low.inf(&point.coords), high.sup(&point.coords))
        });
    let mut picture = Picture::new(SIZE, view.at(Point3::from(0.5 * (low + high)), MARGIN * (high - low).norm()));
    draw(&mut picture, &skin);
    let (vertices, triangles, normals) = model.shape.triangles();
    let drawn = hand.in_palm_frame(best);
    let color = model.color.map(f64::from);
    picture.triangles(&pose_from_array(&drawn.palm_from_object), &vertices, &triangles, &normals, color);
    drawn.contacts.iter().for_each(|point| picture.dot(&Point3::from(*point), DOT, CONTACT));
    picture.finish(&format!("{}\n{} of it, margin {:.2} N", folded(&kind.name), kind.count, best.margin))
}

/// A kind's name on lines that fit a caption, broken after its plus signs.
fn folded(name: &str) -> String {
    let mut lines = vec![String::new()];
    for word in name.split_inclusive('+') {
        if lines.last().is_some_and(|line| line.len() + word.len() > LINE) {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            line.push_str(word);
        }
    }
    lines.join("\n")
}

/// A kind's best grasp as a recording shows it, with its figures in words.
pub fn shown(hand: &Described, kind: &Kind<'_>) -> ShownGrasp {
    let grasp = kind.best;
    let text = format!(
        "- the best of {}\n- margin {:.2} N, overlap {:.2} mm\n- verified for {:.0} g, holds {:.0} g\n- chain {}",
        kind.count,
        grasp.margin,
        1e3 * grasp.penetration,
        1e3 * verified_for(grasp).0,
        1e3 * grasp.proof.map_or(f64::NAN, |proof| proof.payload),
        grasp.chain
    );
    let corners: Vec<Point3<f64>> = skin(hand, &grasp.joints).into_iter().flatten().collect();
    let triangles: Vec<[u32; 3]> = (0..corners.len() as u32 / 3).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect();
    let contacts = grasp.contacts.iter().map(|contact| ShownContact {
        link: contact.link,
        point: hand.palm_from_root * Point3::from(contact.point),
        normal: UnitVector3::new_normalize(hand.palm_from_root * Vector3::from(contact.normal)),
        force: contact.force,
    });
    ShownGrasp {
        name: kind.name.clone(),
        text,
        hand: ShownHand::Other(Mesh::with_normals(&corners, &triangles)),
        palm_from_object: hand.palm_from_root * pose_from_array(&grasp.closed),
        contacts: contacts.collect(),
    }
}
