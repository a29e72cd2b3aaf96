//! Gallery of the best grasp of each kind: `grasps.html` with its images.

use std::path::Path;

use anyhow::Result;
use dexterous_grasping::synthesis::collection::SearchSummary;
use dexterous_grasping::synthesis::held::{DigitUse, pose_from_array};
use dexterous_grasping::synthesis::kind::GraspKind;
use ftac_platform::data::write_atomically;
use grasp_verification::synthesis::grasp_file::GraspFile;
use grasp_verification::synthesis::grasping_hand::GraspingHand;
use grasp_verification::synthesis::parts::table;
use grasp_verification::synthesis::subject::verified_for;
use image::RgbImage;
use maud::html;
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use telemetry::gallery::{GalleryContact, GalleryGrasp, GalleryHand, friction_cone};
use telemetry::mesh::Mesh;
use telemetry::scene::link_color;
use world::objects::ObjectModel;

use crate::html::page;
use crate::picture::{self, Picture, View};
use crate::pictures;

/// Sizes of the pictures of an object and of a grasp, pixels.
const OBJECT_PICTURE_SIZE: u32 = 200;
const GRASP_PICTURE_SIZE: u32 = 260;
/// Width of the view in these pictures, m.
const OBJECT_VIEW_WIDTH: f64 = 0.17;
const GRASP_VIEW_WIDTH: f64 = 0.24;
/// Width of the view of a hand without pads, as a multiple of the diagonal of the drawn geometry.
const VIEW_MARGIN: f64 = 0.95;
/// Maximum number of characters in a line of a caption.
const MAX_CAPTION_LINE: usize = 30;
/// Colours of a hand without pads and of its contact points.
const HAND_COLOR: [f64; 3] = [176.0, 182.0, 192.0];
pub const CONTACT_COLOR: [f64; 3] = [200.0, 30.0, 60.0];
/// Radius of a contact point, m.
pub const CONTACT_DOT_RADIUS: f64 = 2.5e-3;
/// Pictures per row.
const COLUMNS: usize = 6;
/// Opacity of a friction cone, 0 to 1.
const CONE_OPACITY: f64 = 0.55;

/// Returns the hand's collision shapes at joint coordinates (rad or m), three points per triangle, palm frame.
pub fn skin(hand: &GraspingHand, joints: &[f64]) -> Vec<[Point3<f64>; 3]> {
    let links = hand.mechanism().tree.forward(joints);
    hand.body.triangles(&links).into_iter().map(|triangle| triangle.map(|point| hand.palm_from_root * point)).collect()
}

/// Draws the hand: with its pads if they are known, else its collision shapes.
pub fn draw_hand(picture: &mut Picture, hand: &GraspingHand, joints: &[f64]) {
    if let Some(own) = &hand.named_hand {
        return picture.hand(own, joints);
    }
    for [a, b, c] in skin(hand, joints) {
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-15) else { continue };
        picture.triangles(&Isometry3::identity(), &[a, b, c], &[[0, 1, 2]], &[normal; 3], HAND_COLOR);
    }
}

/// Returns a kind's best grasp for drawing, with its figures in words.
pub fn gallery_grasp(hand: &GraspingHand, kind: &GraspKind<'_>) -> GalleryGrasp {
    let grasp = kind.best;
    let mut text = format!(
        "- the best of {}\n- margin {:.2} N, penetration {:.2} mm\n",
        kind.count,
        grasp.margin,
        1e3 * grasp.penetration
    );
    if let Some(DigitUse { digits, palm, approach: [x, y, z], room }) = &grasp.digit_use {
        let digits: Vec<&str> = digits.iter().map(|digit| digit.name()).chain(palm.then_some("palm")).collect();
        let room = room.map_or("none, all digits touch".into(), |room| format!("{:.0} mm to the object", 1e3 * room));
        text += &format!("- held by {}\n- room left by free digits: {room}\n", digits.join(", "));
        text += &format!("- approach along [{x:.2}, {y:.2}, {z:.2}] of the object\n");
    }
    if let Some([far, turned]) = grasp.moved {
        text += &format!("- closing moved the object {:.1} mm, {:.0} deg\n", 1e3 * far, turned.to_degrees());
    }
    if let Some(verification) = grasp.verified_load {
        text +=
            &format!("- verified for {:.0} g, holds {:.0} g\n", 1e3 * verification.mass, 1e3 * verification.payload);
    }
    text += &format!("- chain {}", grasp.chain);
    let contacts = grasp.contacts.iter().map(|contact| GalleryContact {
        link: contact.link,
        point: hand.palm_from_root * Point3::from(contact.point),
        normal: UnitVector3::new_normalize(hand.palm_from_root * Vector3::from(contact.normal)),
        force: contact.force,
    });
    let drawn = || {
        let corners: Vec<Point3<f64>> = skin(hand, &grasp.joints).into_iter().flatten().collect();
        let triangles: Vec<[u32; 3]> = (0..corners.len() as u32 / 3).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect();
        GalleryHand::Other(Mesh::with_normals(&corners, &triangles))
    };
    GalleryGrasp {
        name: kind.name.clone(),
        text,
        hand: hand.named_hand.as_ref().map_or_else(drawn, |_| GalleryHand::Own(grasp.joints.to_vec())),
        palm_from_object: hand.palm_from_root * pose_from_array(&grasp.closed),
        contacts: contacts.collect(),
    }
}

/// Draws a single object in its resting pose.
fn object_picture(model: &ObjectModel, line: &str) -> RgbImage {
    pictures::object(model, OBJECT_PICTURE_SIZE, OBJECT_VIEW_WIDTH, &format!("{}\n{line}", model.name))
}

/// Returns the friction coefficient for which a kind's grasp was verified.
pub fn friction(kind: &GraspKind<'_>) -> f64 {
    verified_for(kind.best).1
}

/// Draws a grasp: hand, object, contact points and cones.
fn grasp_picture(hand: &GraspingHand, model: &ObjectModel, kind: &GraspKind<'_>, view: View) -> RgbImage {
    let shown = gallery_grasp(hand, kind);
    let (center, width) = match hand.named_hand {
        // Centred between object and palm, and a little higher: the caption takes the top.
        Some(_) => {
            (Point3::from(shown.palm_from_object.translation.vector * 0.5 + Vector3::y() * 0.02), GRASP_VIEW_WIDTH)
        }
        None => enclosing_view(&skin(hand, &kind.best.joints)),
    };
    let mut picture = Picture::new(GRASP_PICTURE_SIZE, view.recentered(center, width));
    draw_hand(&mut picture, hand, &kind.best.joints);
    let (vertices, triangles, normals) = model.shape.triangles();
    let color = model.color.map(f64::from);
    picture.triangles(&shown.palm_from_object, &vertices, &triangles, &normals, color);
    for contact in &shown.contacts {
        let cone = friction_cone(contact, friction(kind));
        let color = hand.named_hand.as_ref().map_or(CONTACT_COLOR, |own| link_color(own, contact.link).map(f64::from));
        let tips: Vec<Point3<f64>> = cone.vertices.iter().map(|v| Point3::from(*v).cast()).collect();
        picture.overlay(&tips, &cone.triangles, color, CONE_OPACITY);
        picture.dot(&contact.point, 1.5e-3, color);
    }
    let name = wrap_name(&kind.name);
    picture.finish(&format!("{}\n{name}, {} of it\nmargin {:.2} N", model.name, kind.count, kind.best.margin))
}

/// Returns the centre of the drawn geometry, and the width of a picture that shows all of it, m.
fn enclosing_view(skin: &[[Point3<f64>; 3]]) -> (Point3<f64>, f64) {
    let (low, high) = skin
        .iter()
        .flatten()
        .fold((Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)), |(low, high), point| {
            (low.inf(&point.coords), high.sup(&point.coords))
        });
    (Point3::from(0.5 * (low + high)), VIEW_MARGIN * (high - low).norm())
}

/// Breaks a kind's name after its plus signs into lines that fit a caption.
fn wrap_name(name: &str) -> String {
    let mut lines = vec![String::new()];
    for word in name.split_inclusive('+') {
        if lines.last().is_some_and(|line| line.len() + word.len() > MAX_CAPTION_LINE) {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            line.push_str(word);
        }
    }
    lines.join("\n")
}

/// Writes the page of the grasps of `file` into the existing `folder`; `only` limits it to one object. If the digits of
/// a hand have no names, its kinds, `most` at most, are shown from three sides.
pub fn write(file: &GraspFile, only: Option<&str>, most: usize, folder: &Path) -> Result<()> {
    let hand = &file.hand;
    let (views, most, columns) = match hand.named_hand {
        Some(_) => (vec![View::palm()], 2 * COLUMNS, COLUMNS),
        None => (vec![View::palm(), View::thumb_side(), View::tips()], most, 3),
    };
    let (mut objects, mut best, mut sections) = (Vec::new(), Vec::new(), Vec::new());
    for entry in file.objects(only)? {
        let name = &entry.summary.object;
        let model = &*file.model(name)?;
        let (low, high) = model.shape.aabb();
        let size = (high - low) * 1e3;
        objects.push(object_picture(
            model,
            &format!(
                "{:.0}x{:.0}x{:.0} mm\n{:.0} g\n{} grasps",
                size.x,
                size.y,
                size.z,
                1e3 * model.mass,
                entry.grasps.len()
            ),
        ));
        let kinds = file.kinds(entry);
        let of = |kind| views.iter().map(move |view| grasp_picture(hand, model, kind, *view));
        let pictures: Vec<RgbImage> = kinds.iter().take(most).flat_map(of).collect();
        best.extend(pictures.first().cloned());
        let sheet = format!("{name}.png");
        picture::save(&picture::tile(&pictures, columns), &folder.join(&sheet))?;
        let short = entry.summary.short.as_deref().unwrap_or("");
        let SearchSummary { kept, requested: wanted, chains, .. } = &entry.summary;
        sections.push(html! {
            h2 { (name) }
            p { (kept) " grasps of " (wanted) " from " (chains) " chains, " (kinds.len()) " kinds. " (short) }
            img src=(sheet) alt={ "grasps of " (name) };
        });
    }
    picture::save(&picture::tile(&objects, COLUMNS), &folder.join("objects.png"))?;
    picture::save(&picture::tile(&best, COLUMNS), &folder.join("best.png"))?;
    let main = html! {
        h1 { "Synthesized grasps" }
        p.byline { (file.collection.header.command) }
        p { "Dots are contact points, cones the friction cones of the verification, coloured by digit." }
        h2 { "Objects" }
        img src="objects.png" alt="the objects";
        h2 { "The best grasp of each object's most frequent kind" }
        img src="best.png" alt="a grasp of each object";
        @if hand.named_hand.is_some() {
            h2 { "Diversity" }
            pre { (table(&file.collection)) }
        }
        @for section in sections { (section) }
    };
    let html = page("Synthesized grasps", "img{max-width:100%}", &main, "");
    Ok(write_atomically(&folder.join("grasps.html"), html.as_bytes())?)
}

#[cfg(test)]
mod tests {
    use dexterous_grasping::synthesis::held::HeldGrasp;
    use dexterous_grasping::synthesis::kind::ftac_grasp_kinds;
    use grasp_verification::synthesis::grasp_file;
    use world::objects::ObjectSet;

    /// Checks the built-in collection: every object of the set is there with the number of grasps in its summary, each
    /// with its digits, and every grasp passes the checks.
    #[test]
    fn the_built_in_collection_is_whole() {
        let collection = grasp_file::built_in().expect("reads");
        let set = ObjectSet::repertoire();
        for name in set.names() {
            let entry = collection.for_object(name).unwrap_or_else(|| panic!("grasps of {name}"));
            assert_eq!(entry.summary.kept, entry.grasps.len());
            assert!(entry.summary.short.is_some() || entry.grasps.len() == entry.summary.requested, "{name}");
            assert!(ftac_grasp_kinds(&entry.grasps).len() > 3, "{name}");
        }
        let good = |grasp: &HeldGrasp| {
            grasp.margin >= 1.0 && grasp.penetration <= 1e-3 && (grasp.palm() || grasp.digits().len() >= 2)
        };
        let bad: Vec<_> = collection.grasps().filter(|grasp| !good(grasp)).map(|g| (&g.object, g.chain)).collect();
        assert!(bad.is_empty(), "{bad:?}");
    }
}
