//! Picture sheet with one row per hand and one column per object; each cell shows the held grasp with the largest
//! wrench margin.

use std::path::Path;

use anyhow::{Context, Result};
use dexterous_grasping::synthesis::held::pose_from_array;
use grasp_verification::synthesis::hands::{BestGrasp, ComparedHand, ComparisonCell};
use image::RgbImage;
use nalgebra::{Point3, Vector3};
use report::grasp_gallery::{CONTACT_COLOR, CONTACT_DOT_RADIUS, draw_hand, skin};
use report::picture::{Picture, View, save, tile};
use world::objects::{ObjectModel, ObjectSet};

/// Side of a picture, pixels.
const PICTURE_SIZE: u32 = 230;
/// Width of a picture, as a multiple of the drawn geometry, and share of it by which the view moves down to leave room
/// for the caption.
const VIEW_MARGIN: f64 = 1.35;
const CAPTION_SHARE: f64 = 0.07;

/// Draws the sheet; `cells` are in the order of `hands`.
pub fn write(hands: &[ComparedHand], cells: &[ComparisonCell], path: &Path) -> Result<()> {
    let set = ObjectSet::repertoire();
    let mut pictures = Vec::new();
    for cell in cells {
        let hand = hands.iter().find(|hand| hand.hand.name() == cell.inputs.hand).context("a cell of no hand")?;
        let model = set.get(&cell.inputs.object).context("a cell of no object")?;
        pictures.push(picture(hand, model, cell));
    }
    save(&tile(&pictures, cells.len() / hands.len()), path)
}

fn picture(hand: &ComparedHand, model: &ObjectModel, cell: &ComparisonCell) -> RgbImage {
    let of = cell.rate();
    let caption = format!("{}\n{}\n{} of {}", cell.inputs.hand, cell.inputs.object, of.count, of.of);
    let Some(best) = &cell.best else {
        return Picture::new(PICTURE_SIZE, View::palm()).finish(&format!("{caption}\nno grasp held"));
    };
    let mut picture = Picture::new(PICTURE_SIZE, view(&skin(&hand.hand, &best.joints), model, best));
    draw_hand(&mut picture, &hand.hand, &best.joints);
    let (vertices, triangles, normals) = model.shape.triangles();
    let color = model.color.map(f64::from);
    picture.triangles(&pose_from_array(&best.palm_from_object), &vertices, &triangles, &normals, color);
    best.contacts.iter().for_each(|point| picture.dot(&Point3::from(*point), CONTACT_DOT_RADIUS, CONTACT_COLOR));
    picture.finish(&format!("{caption}, {:.1} N", best.margin))
}

/// Returns a view onto the palm that shows hand and object.
fn view(skin: &[[Point3<f64>; 3]], model: &ObjectModel, best: &BestGrasp) -> View {
    let palm_from_object = pose_from_array(&best.palm_from_object);
    let (a, b) = model.shape.aabb();
    let corner = |n: usize, axis: usize| if n >> axis & 1 == 1 { b[axis] } else { a[axis] };
    let corners = (0..8).map(|n| palm_from_object * Point3::new(corner(n, 0), corner(n, 1), corner(n, 2)));
    let (low, high) = skin
        .iter()
        .flatten()
        .copied()
        .chain(corners)
        .fold((Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)), |(low, high), point| {
            (low.inf(&point.coords), high.sup(&point.coords))
        });
    let (size, middle) = (high - low, 0.5 * (low + high));
    let width = VIEW_MARGIN * size.x.max(size.y);
    View::palm().recentered(Point3::from(middle + Vector3::y() * CAPTION_SHARE * width), width)
}
