//! `ftac grasps show`: the best grasp of each kind, in Rerun, as pictures, and in words.
//!
//! A kind is a set of digits with a kind of opposition; the best of it has the largest wrench margin.

use clap::Args;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use grasping::synthesis::collection::Collection;
use grasping::synthesis::diversity::{self, digit_set, opposition};
use grasping::synthesis::held::{HeldGrasp, pose_from_array};
use hand_model::Hand;
use image::RgbImage;
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use scenarios::objects::{ObjectModel, ObjectSet};
use stream::Target;
use stream::gallery::{self, ShownContact, ShownGrasp};

use crate::terminal::Outcome;
use crate::terminal::Terminal;
use bench::recording::drawn;
use proving::synthesis::repertoire;
use proving::synthesis::subject::TEST_FRICTION;
use report::picture::{self, Picture, View};
use report::{html::escape, write_whole};

/// Arguments of `grasps show`.
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// Object; without one, a table of all.
    pub object: Option<String>,
    /// File of grasps, from `repertoire` or `generate`; default: the built-in repertoire.
    #[arg(long)]
    pub grasps: Option<PathBuf>,
    /// Kinds at most, the most frequent first.
    #[arg(long, default_value_t = 12)]
    pub kinds: usize,
    /// Recording file; default: recordings/grasps_OBJECT.rrd, which is then opened in the Rerun viewer.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Folder for grasps.html with pictures of objects and grasps, instead of a recording.
    #[arg(long, conflicts_with = "out")]
    pub report: Option<PathBuf>,
}

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

/// A kind of grasp: how many there are of it, and the best.
struct Kind<'a> {
    name: String,
    count: usize,
    best: &'a HeldGrasp,
}

/// The kinds among `grasps`, the most frequent first.
fn kinds<'a>(grasps: &'a [HeldGrasp]) -> Vec<Kind<'a>> {
    let mut found: BTreeMap<String, Kind<'a>> = BTreeMap::new();
    for grasp in grasps {
        let name = format!("{} {}", digit_set(grasp), opposition(grasp).name());
        let kind = found.entry(name.clone()).or_insert(Kind { name, count: 0, best: grasp });
        kind.count += 1;
        if grasp.margin > kind.best.margin {
            kind.best = grasp;
        }
    }
    let mut kinds: Vec<Kind<'a>> = found.into_values().collect();
    kinds.sort_by(|a, b| b.count.cmp(&a.count).then_with(|| a.name.cmp(&b.name)));
    kinds
}

fn shown(kind: &Kind<'_>) -> ShownGrasp {
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
        joints: grasp.joints.to_vec(),
        palm_from_object: pose_from_array(&grasp.palm_from_object),
        contacts: contacts.collect(),
    }
}

/// `ftac grasps show`.
pub fn show(terminal: &Terminal, args: &ShowArgs) -> Outcome {
    let collection = match &args.grasps {
        Some(path) => repertoire::read(path)?,
        None => repertoire::built_in()?,
    };
    if let Some(name) = &args.object
        && collection.of(name).is_none()
    {
        let known: Vec<&str> = collection.objects.iter().map(|entry| entry.summary.object.as_str()).collect();
        bail!("OBJECT: no grasps of `{name}`; there are some of: {}", known.join(", "));
    }
    let set = ObjectSet::repertoire();
    let hand = Hand::ftac();
    if let Some(folder) = &args.report {
        report(&collection, args.object.as_deref(), &set, &hand, folder)?;
        eprintln!("{}: grasps.html with its pictures", folder.display());
    }
    if terminal.json {
        let lines = collection.objects.iter().filter(|entry| wanted(args, &entry.summary.object)).map(|entry| {
            let kinds: Vec<_> = kinds(&entry.grasps)
                .iter()
                .map(|kind| serde_json::json!({"kind": kind.name, "count": kind.count, "best": kind.best}))
                .collect();
            serde_json::json!({
                "object": entry.summary.object,
                "diversity": diversity::describe(&entry.grasps),
                "kinds": kinds,
            })
        });
        println!("{}", serde_json::json!({ "objects": lines.collect::<Vec<_>>() }));
    } else if let Some(name) = &args.object {
        print_kinds(&collection, name);
    } else {
        print!("{}", super::collection::table(&collection));
    }
    if let Some(name) = &args.object
        && args.report.is_none()
    {
        record(terminal, args, &collection, name, &set, &hand)?;
    }
    Ok(None)
}

fn wanted(args: &ShowArgs, object: &str) -> bool {
    args.object.as_ref().is_none_or(|name| name == object)
}

fn print_kinds(collection: &Collection, name: &str) {
    println!("{:18} {:>5} {:>8} {:>8} {:>8}", "kind", "count", "margin N", "room mm", "moved mm");
    for kind in collection.of(name).iter().flat_map(|entry| kinds(&entry.grasps)) {
        let room = kind.best.room.map_or("-".into(), |room| format!("{:.0}", 1e3 * room));
        let (margin, moved) = (kind.best.margin, 1e3 * kind.best.moved[0]);
        println!("{:18} {:5} {margin:8.2} {room:>8} {moved:8.1}", kind.name, kind.count);
    }
}

fn object_of(set: &ObjectSet, name: &str) -> Result<ObjectModel> {
    match set.get(name) {
        Some(model) => Ok((**model).clone()),
        None => bail!("`{name}` is not an object of the set: its shape is not known here"),
    }
}

fn record(
    terminal: &Terminal,
    args: &ShowArgs,
    collection: &Collection,
    name: &str,
    set: &ObjectSet,
    hand: &Hand,
) -> Result<()> {
    let entry = collection.of(name).context("no grasps")?;
    let mut kinds = kinds(&entry.grasps);
    kinds.truncate(args.kinds);
    let grasps: Vec<ShownGrasp> = kinds.iter().map(shown).collect();
    let model = object_of(set, name)?;
    let drawn = drawn(&model, name);
    let file = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("recordings/grasps_{name}.rrd")));
    gallery::write(&[Target::File(file.clone())], hand, &drawn, TEST_FRICTION, &grasps)?;
    if !terminal.quiet {
        eprintln!("{}: {} kinds; see it with `ftac view {0}`", file.display(), grasps.len());
    }
    // Who names a file wants the file; who does not wants to see it.
    if args.out.is_none() {
        stream::viewer::open(&file)?;
    }
    Ok(())
}

/// A picture of an object on its own, as it rests.
fn object_picture(model: &ObjectModel, line: &str) -> RgbImage {
    let view = View {
        eye: Vector3::new(0.75, -0.9, 0.75).normalize(),
        up: Vector3::z(),
        center: Point3::origin(),
        width: OBJECT_WIDTH,
    };
    let mut picture = Picture::new(OBJECT_PICTURE, view);
    let (vertices, triangles, normals) = model.shape.triangles();
    let color = model.color.map(f64::from);
    picture.triangles(&Isometry3::from_parts(Default::default(), model.rest), &vertices, &triangles, &normals, color);
    picture.finish(&format!("{}\n{line}", model.name))
}

/// A picture of a grasp: hand, object, contact points and cones.
fn grasp_picture(hand: &Hand, model: &ObjectModel, kind: &Kind<'_>) -> RgbImage {
    let shown = shown(kind);
    // Between object and palm, and a little higher: the caption takes the top.
    let center = Point3::from(shown.palm_from_object.translation.vector * 0.5 + Vector3::y() * 0.02);
    let mut picture = Picture::new(GRASP_PICTURE, View::palm().at(center, GRASP_WIDTH));
    picture.hand(hand, &shown.joints);
    let (vertices, triangles, normals) = model.shape.triangles();
    let color = model.color.map(f64::from);
    picture.triangles(&shown.palm_from_object, &vertices, &triangles, &normals, color);
    for contact in &shown.contacts {
        let cone = gallery::friction_cone(contact, TEST_FRICTION);
        let color = stream::scene::link_color(contact.link).map(f64::from);
        let tips: Vec<Point3<f64>> = cone.vertices.iter().map(|v| Point3::from(*v).cast()).collect();
        picture.veil(&tips, &cone.triangles, color, CONE_COVERS);
        picture.dot(&contact.point, 1.5e-3, color);
    }
    let caption = format!("{}\n{}, {} of it\nmargin {:.2} N", model.name, kind.name, kind.count, kind.best.margin);
    picture.finish(&caption)
}

fn report(collection: &Collection, only: Option<&str>, set: &ObjectSet, hand: &Hand, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("--report {}", folder.display()))?;
    let (mut objects, mut best, mut sections) = (Vec::new(), Vec::new(), String::new());
    for entry in collection.objects.iter().filter(|entry| only.is_none_or(|name| name == entry.summary.object)) {
        let name = &entry.summary.object;
        let model = object_of(set, name)?;
        let (low, high) = model.shape.aabb();
        let size = (high - low) * 1e3;
        objects.push(object_picture(
            &model,
            &format!(
                "{:.0}x{:.0}x{:.0} mm\n{:.0} g\n{} grasps",
                size.x,
                size.y,
                size.z,
                1e3 * model.mass,
                entry.grasps.len()
            ),
        ));
        let kinds = kinds(&entry.grasps);
        let pictures: Vec<RgbImage> =
            kinds.iter().take(2 * COLUMNS).map(|kind| grasp_picture(hand, &model, kind)).collect();
        best.extend(pictures.first().cloned());
        let file = format!("{name}.png");
        picture::save(&picture::tile(&pictures, COLUMNS), &folder.join(&file))?;
        let short = entry.summary.short.as_deref().unwrap_or("");
        sections += &format!(
            "<h2>{0}</h2>\n<p>{1} grasps of {2} from {3} chains, {4} kinds. {5}</p>\n<img src=\"{file}\" alt=\"grasps of {0}\">\n",
            escape(name),
            entry.summary.kept,
            entry.summary.wanted,
            entry.summary.chains,
            kinds.len(),
            escape(short)
        );
    }
    picture::save(&picture::tile(&objects, COLUMNS), &folder.join("objects.png"))?;
    picture::save(&picture::tile(&best, COLUMNS), &folder.join("best.png"))?;
    let html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>Synthesized grasps</title>\n<style>{}{}img{{max-width:100%}}</style>\n\
         </head>\n<body>\n<main>\n<h1>Synthesized grasps</h1>\n<p class=\"byline\">{}</p>\n<p>Dots are contact points, cones the forces that friction {TEST_FRICTION} \
         allows there, coloured by digit.</p>\n<h2>Objects</h2>\n<img src=\"objects.png\" alt=\"the objects\">\n<h2>The best grasp of each object's most frequent kind</h2>\n\
         <img src=\"best.png\" alt=\"a grasp of each object\">\n<h2>Diversity</h2>\n<pre>{}</pre>\n{sections}</main>\n</body>\n</html>\n",
        report::style::FIGURE,
        report::style::PAGE,
        escape(&collection.header.command),
        escape(&super::collection::table(collection)),
    );
    write_whole(&folder.join("grasps.html"), html.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The checked-in repertoire: every object of the set, as many grasps as its lines say, each with its digits, and nothing
    /// that the checks would not pass.
    #[test]
    fn the_built_in_repertoire_is_whole() {
        let collection = repertoire::built_in().expect("reads");
        let set = ObjectSet::repertoire();
        for name in set.names() {
            let entry = collection.of(name).unwrap_or_else(|| panic!("grasps of {name}"));
            assert_eq!(entry.summary.kept, entry.grasps.len());
            assert!(entry.summary.short.is_some() || entry.grasps.len() == entry.summary.wanted, "{name}");
            assert!(kinds(&entry.grasps).len() > 3, "{name}");
        }
        let good = |grasp: &HeldGrasp| {
            grasp.margin >= 1.0 && grasp.penetration <= 1e-3 && (grasp.palm || grasp.digits.len() >= 2)
        };
        let bad: Vec<_> = collection.grasps().filter(|grasp| !good(grasp)).map(|g| (&g.object, g.chain)).collect();
        assert!(bad.is_empty(), "{bad:?}");
    }
}
