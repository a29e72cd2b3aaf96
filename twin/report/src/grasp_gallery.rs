//! The best grasp of each kind, as pictures: `grasps.html` with its images.

use std::path::Path;

use anyhow::Result;
use grasping::synthesis::collection::{Collection, Summary};
use grasping::synthesis::held::pose_from_array;
use grasping::synthesis::kind::{HandKind, hand_kinds};
use hand_model::Hand;
use image::RgbImage;
use maud::html;
use nalgebra::{Point3, UnitVector3, Vector3};
use platform::data::write_whole;
use proving::synthesis::grasp_file::GraspFile;
use proving::synthesis::parts::table;
use proving::synthesis::subject::verified_for;
use stream::gallery::{ShownContact, ShownGrasp, ShownHand, friction_cone};
use world::objects::ObjectModel;

use crate::html::page;
use crate::picture::{self, Picture, View};
use crate::pictures;

/// Sizes of a picture: an object's, a grasp's, pixels.
const OBJECT_PICTURE: u32 = 200;
const GRASP_PICTURE: u32 = 260;
/// Width of what a picture shows, m.
const OBJECT_WIDTH: f64 = 0.17;
const GRASP_WIDTH: f64 = 0.24;
/// Pictures in a row.
const COLUMNS: usize = 6;
/// How much of a cone covers what is behind it.
const CONE_COVERS: f64 = 0.55;

/// A kind's best grasp as it is drawn, with its figures in words.
pub fn shown(kind: &HandKind<'_>) -> ShownGrasp {
    let grasp = kind.best;
    let digits: Vec<&str> = grasp.digits.iter().map(|digit| digit.name()).collect();
    let room = grasp.room.map_or("none, all digits touch".into(), |room| format!("{:.0} mm to the object", 1e3 * room));
    let text = format!(
        "- the best of {}; digits {}{}\n- margin {:.2} N, penetration {:.2} mm\n- room left by free digits: {room}\n- \
         comes along [{:.2}, {:.2}, {:.2}] of the object\n- closing moved the object {:.1} mm, {:.0} deg\n- chain {}",
        kind.count,
        digits.join(", "),
        if grasp.palm { " and the palm" } else { "" },
        grasp.margin,
        1e3 * grasp.penetration,
        grasp.approach[0],
        grasp.approach[1],
        grasp.approach[2],
        1e3 * grasp.moved[0],
        grasp.moved[1].to_degrees(),
        grasp.chain
    );
    let contacts = grasp.contacts.iter().map(|contact| ShownContact {
        link: contact.link,
        point: contact.point.into(),
        normal: UnitVector3::new_normalize(contact.normal.into()),
        force: contact.force,
    });
    ShownGrasp {
        name: kind.name.clone(),
        text,
        hand: ShownHand::Own(grasp.joints.to_vec()),
        palm_from_object: pose_from_array(&grasp.palm_from_object),
        contacts: contacts.collect(),
    }
}

/// A picture of an object on its own, as it rests.
fn object_picture(model: &ObjectModel, line: &str) -> RgbImage {
    pictures::object(model, OBJECT_PICTURE, OBJECT_WIDTH, &format!("{}\n{line}", model.name))
}

/// Friction for which a kind's grasp was verified.
pub fn friction(kind: &HandKind<'_>) -> f64 {
    verified_for(kind.best).1
}

/// A picture of a grasp: hand, object, contact points and cones.
fn grasp_picture(hand: &Hand, model: &ObjectModel, kind: &HandKind<'_>) -> RgbImage {
    let shown = shown(kind);
    // Between object and palm, and a little higher: the caption takes the top.
    let center = Point3::from(shown.palm_from_object.translation.vector * 0.5 + Vector3::y() * 0.02);
    let mut picture = Picture::new(GRASP_PICTURE, View::palm().at(center, GRASP_WIDTH));
    picture.hand(hand, &kind.best.joints);
    let (vertices, triangles, normals) = model.shape.triangles();
    let color = model.color.map(f64::from);
    picture.triangles(&shown.palm_from_object, &vertices, &triangles, &normals, color);
    for contact in &shown.contacts {
        let cone = friction_cone(contact, friction(kind));
        let color = stream::scene::link_color(hand, contact.link).map(f64::from);
        let tips: Vec<Point3<f64>> = cone.vertices.iter().map(|v| Point3::from(*v).cast()).collect();
        picture.veil(&tips, &cone.triangles, color, CONE_COVERS);
        picture.dot(&contact.point, 1.5e-3, color);
    }
    let caption = format!("{}\n{}, {} of it\nmargin {:.2} N", model.name, kind.name, kind.count, kind.best.margin);
    picture.finish(&caption)
}

/// Writes the page of `collection`, which `file` holds, into `folder`, which is there already; `only` limits it to one object.
pub fn write(file: &GraspFile, collection: &Collection, only: Option<&str>, hand: &Hand, folder: &Path) -> Result<()> {
    let (mut objects, mut best, mut sections) = (Vec::new(), Vec::new(), Vec::new());
    for entry in collection.objects.iter().filter(|entry| only.is_none_or(|name| name == entry.summary.object)) {
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
        let kinds = hand_kinds(&entry.grasps);
        let pictures: Vec<RgbImage> =
            kinds.iter().take(2 * COLUMNS).map(|kind| grasp_picture(hand, model, kind)).collect();
        best.extend(pictures.first().cloned());
        let file = format!("{name}.png");
        picture::save(&picture::tile(&pictures, COLUMNS), &folder.join(&file))?;
        let short = entry.summary.short.as_deref().unwrap_or("");
        let Summary { kept, wanted, chains, .. } = &entry.summary;
        sections.push(html! {
            h2 { (name) }
            p { (kept) " grasps of " (wanted) " from " (chains) " chains, " (kinds.len()) " kinds. " (short) }
            img src=(file) alt={ "grasps of " (name) };
        });
    }
    picture::save(&picture::tile(&objects, COLUMNS), &folder.join("objects.png"))?;
    picture::save(&picture::tile(&best, COLUMNS), &folder.join("best.png"))?;
    let main = html! {
        h1 { "Synthesized grasps" }
        p.byline { (collection.header.command) }
        p { "Dots are contact points, cones the forces that the friction of the proof allows there, coloured by digit." }
        h2 { "Objects" }
        img src="objects.png" alt="the objects";
        h2 { "The best grasp of each object's most frequent kind" }
        img src="best.png" alt="a grasp of each object";
        h2 { "Diversity" }
        pre { (table(collection)) }
        @for section in sections { (section) }
    };
    let html = page("Synthesized grasps", "img{max-width:100%}", &main, "");
    Ok(write_whole(&folder.join("grasps.html"), html.as_bytes())?)
}

#[cfg(test)]
mod tests {
    use grasping::synthesis::held::HeldGrasp;
    use proving::synthesis::grasp_file;
    use world::objects::ObjectSet;

    use super::*;

    /// The built-in collection: every object of the set, as many grasps as its lines say, each with its digits, and nothing
    /// that the checks would not pass.
    #[test]
    fn the_built_in_collection_is_whole() {
        let collection = grasp_file::built_in().expect("reads");
        let set = ObjectSet::repertoire();
        for name in set.names() {
            let entry = collection.of(name).unwrap_or_else(|| panic!("grasps of {name}"));
            assert_eq!(entry.summary.kept, entry.grasps.len());
            assert!(entry.summary.short.is_some() || entry.grasps.len() == entry.summary.wanted, "{name}");
            assert!(hand_kinds(&entry.grasps).len() > 3, "{name}");
        }
        let good = |grasp: &HeldGrasp| {
            grasp.margin >= 1.0 && grasp.penetration <= 1e-3 && (grasp.palm || grasp.digits.len() >= 2)
        };
        let bad: Vec<_> = collection.grasps().filter(|grasp| !good(grasp)).map(|g| (&g.object, g.chain)).collect();
        assert!(bad.is_empty(), "{bad:?}");
    }
}
