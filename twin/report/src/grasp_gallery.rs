//! Gallery of the best grasp of each kind: `grasps.html` with its images.

use std::path::Path;

use anyhow::Result;
use dexterous_grasping::synthesis::collection::{ObjectGrasps, SearchSummary};
use dexterous_grasping::synthesis::diversity::{self, Opposition, opposition};
use dexterous_grasping::synthesis::held::{DigitUse, pose_from_array};
use dexterous_grasping::synthesis::kind::GraspKind;
use ftac_platform::data::write_atomically;
use grasp_verification::synthesis::grasp_file::GraspFile;
use grasp_verification::synthesis::grasping_hand::GraspingHand;
use grasp_verification::synthesis::subject::verified_for;
use hand_model::Digit;
use image::RgbImage;
use maud::{Markup, html};
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use telemetry::gallery::{GalleryContact, GalleryGrasp, GalleryHand, friction_cone};
use telemetry::mesh::Mesh;
use telemetry::scene::link_color;
use world::objects::ObjectModel;

use crate::html::{ColumnAlignment, HtmlTable, count_with_noun, format_number, page};
use crate::picture::{self, Picture, View, hand_points};
use crate::pictures;

/// Sizes of the pictures of an object and of a grasp, pixels.
const OBJECT_PICTURE_SIZE: u32 = 200;
const GRASP_PICTURE_SIZE: u32 = 260;
/// Width of the view of an object, m.
const OBJECT_VIEW_WIDTH: f64 = 0.17;
/// Colours of a hand without pads and of its contact points.
const HAND_COLOR: [f64; 3] = [176.0, 182.0, 192.0];
pub const CONTACT_COLOR: [f64; 3] = [200.0, 30.0, 60.0];
/// Radius of a contact point, m.
pub const CONTACT_DOT_RADIUS: f64 = 2.5e-3;
/// Opacities of a friction cone, and of the object over the digits that hide it, 0 to 1.
const CONE_OPACITY: f64 = 0.55;
const OBJECT_OPACITY: f64 = 0.4;

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

/// Returns the friction coefficient for which a kind's grasp was verified.
pub fn friction(kind: &GraspKind<'_>) -> f64 {
    verified_for(kind.best).1
}

/// Draws a grasp: hand, object, contact points and cones. The object shows through the digits in front of it.
fn grasp_picture(hand: &GraspingHand, model: &ObjectModel, kind: &GraspKind<'_>, view: View) -> RgbImage {
    let shown = gallery_grasp(hand, kind);
    let points = match &hand.named_hand {
        Some(own) => hand_points(own, &kind.best.joints),
        None => skin(hand, &kind.best.joints).into_iter().flatten().collect(),
    };
    let mut picture = Picture::new(GRASP_PICTURE_SIZE, view.enclosing(&points));
    draw_hand(&mut picture, hand, &kind.best.joints);
    let (vertices, triangles, normals) = model.shape.triangles();
    let color = model.color.map(f64::from);
    picture.triangles(&shown.palm_from_object, &vertices, &triangles, &normals, color);
    let placed: Vec<Point3<f64>> = vertices.iter().map(|vertex| shown.palm_from_object * vertex).collect();
    picture.overlay(&placed, &triangles, color, OBJECT_OPACITY);
    for contact in &shown.contacts {
        let cone = friction_cone(contact, friction(kind));
        let color = hand.named_hand.as_ref().map_or(CONTACT_COLOR, |own| link_color(own, contact.link).map(f64::from));
        let tips: Vec<Point3<f64>> = cone.vertices.iter().map(|v| Point3::from(*v).cast()).collect();
        picture.overlay(&tips, &cone.triangles, color, CONE_OPACITY);
        picture.dot(&contact.point, 1.5e-3, color);
    }
    picture.finish("")
}

/// Says in words what a kind's grasp is: its digits and the direction in which they press, or its name for a hand
/// whose digits have none.
fn words(kind: &GraspKind<'_>) -> String {
    let Some(DigitUse { digits, palm, .. }) = &kind.best.digit_use else { return kind.name.clone() };
    let names: Vec<&str> = palm.then_some("palm").into_iter().chain(digits.iter().map(|digit| digit.name())).collect();
    format!("{}; {} opposition", names.join(", "), opposition(kind.best).name())
}

/// Writes the pictures of a kind's grasp, one per view, and returns them with a caption.
fn figures(
    (hand, model): (&GraspingHand, &ObjectModel),
    (number, kind): (usize, &GraspKind<'_>),
    views: &[View],
    folder: &Path,
) -> Result<Markup> {
    let mut files = Vec::new();
    for (n, view) in views.iter().enumerate() {
        files.push(format!("{}_{number}_{n}.png", model.name));
        picture::save(&grasp_picture(hand, model, kind, *view), &folder.join(&files[n]))?;
    }
    let words = words(kind);
    Ok(html! {
        figure {
            @for file in &files { img src=(file) width=(GRASP_PICTURE_SIZE) height=(GRASP_PICTURE_SIZE) alt={ (model.name) " held by " (words) }; }
            figcaption { (words) br; (count_with_noun(kind.count, "grasp")) ", margin " (format_number(kind.best.margin, 2)) " N" }
        }
    })
}

/// Makes the table of the objects' diversity.
fn diversity_table(entries: &[&ObjectGrasps]) -> HtmlTable {
    use ColumnAlignment::{Numbers, Words};
    let digits = Digit::ALL.map(|digit| digit.name());
    let mut head = vec![("object", Words), ("grasps", Numbers), ("chains", Numbers), ("sets of digits", Numbers)];
    head.extend(digits.iter().map(|name| (*name, Numbers)));
    head.push(("palm", Numbers));
    let kinds = Opposition::ALL.map(|kind| format!("{} opposition", kind.name()));
    head.extend(kinds.iter().map(|name| (name.as_str(), Numbers)));
    head.extend([("thumb abducted", Numbers), ("1 component", Numbers), ("3", Numbers), ("6", Numbers)]);
    let mut table = HtmlTable::new("Shares in percent", &head);
    for entry in entries {
        let found = diversity::describe(&entry.grasps);
        let percent = |share: f64| format_number(100.0 * share, 0);
        let mut row = vec![entry.summary.object.clone()];
        row.extend([found.grasps.to_string(), entry.summary.chains.to_string(), found.sets.len().to_string()]);
        row.extend(found.digits.iter().chain([&found.palm]).map(|share| percent(*share)));
        row.extend(Opposition::ALL.map(|kind| percent(found.opposition_share(kind))));
        row.push(percent(found.thumb[2]));
        row.extend([1, 3, 6].map(|n| percent(found.explained.get(n - 1).copied().unwrap_or(f64::NAN))));
        table.row(&row);
    }
    table
}

/// Pictures with their captions are as wide as the pictures.
const STYLE: &str =
    ".objects{gap:20px}.objects figure{width:min-content;text-align:left}.objects img{display:block;max-width:none}";
/// Explains the words of the page.
const TERMS: &str = "Dots are the points of contact and cones the friction cones of the verification, coloured by digit; the object shows through \
    the digits in front of it. A kind is a set of parts of the hand that touch the object, with the direction in which thumb or palm press \
    on it: along the palm (pad opposition), perpendicular to it (palm opposition), or across it (side opposition); in finger opposition neither \
    touches. Shown is the best grasp of each kind, which has the largest margin: the force, in any direction, that the grasp resists.";
const DIVERSITY_TERMS: &str = "For each object: grasps kept and chains of the search that it took; how many different sets of digits touch; \
    the share of the grasps in which each digit and the palm touch, of each kind of opposition, and of those with an abducted thumb, which faces the \
    fingers; and how much of the joint angles' variance the first 1, 3 and 6 principal components explain.";

/// Writes the page of the grasps of `file` into the existing `folder`, with `most` kinds of each object at most; `only`
/// limits it to one object. A hand whose digits have no names is shown from three sides.
pub fn write(file: &GraspFile, only: Option<&str>, most: usize, folder: &Path) -> Result<()> {
    let hand = &file.hand;
    let views = match hand.named_hand {
        Some(_) => vec![View::palm()],
        None => vec![View::palm(), View::thumb_side(), View::tips()],
    };
    let entries = file.objects(only)?;
    let (mut objects, mut sections) = (Vec::new(), Vec::new());
    for entry in &entries {
        let name = &entry.summary.object;
        let model = &*file.model(name)?;
        let (low, high) = model.shape.aabb();
        let size = (high - low) * 1e3;
        let picture = format!("{name}.png");
        picture::save(&pictures::object(model, OBJECT_PICTURE_SIZE, OBJECT_VIEW_WIDTH, ""), &folder.join(&picture))?;
        objects.push(html! {
            figure {
                a href={ "#" (name) } { img src=(picture) width=(OBJECT_PICTURE_SIZE) height=(OBJECT_PICTURE_SIZE) alt=(name); }
                figcaption {
                    (name) br;
                    (format!("{:.0} x {:.0} x {:.0} mm, {:.0} g", size.x, size.y, size.z, 1e3 * model.mass)) br;
                    (count_with_noun(entry.grasps.len(), "grasp"))
                }
            }
        });
        let kinds = file.kinds(entry);
        let drawn = kinds.iter().take(most).enumerate();
        let grasps = drawn.map(|kind| figures((hand, model), kind, &views, folder)).collect::<Result<Vec<_>>>()?;
        let short = entry.summary.short.as_deref().unwrap_or("");
        let SearchSummary { kept, requested: wanted, chains, .. } = &entry.summary;
        sections.push(html! {
            h2 id=(name) { (name) }
            p { (kept) " grasps of " (wanted) " from " (chains) " chains, " (kinds.len()) " kinds, the most frequent first. " (short) }
            div.objects { @for grasp in grasps { (grasp) } }
        });
    }
    let main = html! {
        h1 { "Synthesized grasps" }
        p.byline { (file.collection.header.command) }
        p {
            @if let Some(own) = &hand.named_hand { "The hand is a " (own.parameters.handedness) " one, seen from the side of its palm. " }
            (TERMS)
        }
        h2 { "Objects" }
        div.objects { @for object in objects { (object) } }
        @for section in sections { (section) }
        @if hand.named_hand.is_some() {
            h2 { "Diversity" }
            p { (DIVERSITY_TERMS) }
            (diversity_table(&entries))
        }
    };
    let html = page("Synthesized grasps", STYLE, &main, "");
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
