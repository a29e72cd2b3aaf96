//! `ftac bridge sheet`: the places of a combination's objects, as a sheet to print in full size and lay on the table.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Result, bail};
use bench::builtin::{make_bench, make_scene_bench};
use clap::Args;
use hand_model::RobotModel;
use nalgebra::{Isometry3, Point3};
use registration::{Registrar, RegistrationPlan};
use scenarios::Scenario;
use scenarios::noise::TrialNoise;
use schemars::JsonSchema;
use serde::Serialize;
use world::objects::{ObjectModel, Symmetry};

use super::shared::display_path;
use crate::options::robot::RobotArgs;
use crate::terminal::Terminal;

/// Size of A3 landscape, mm: the long side lies along the world's y axis.
const SHEET_SIZE_MM: [f64; 2] = [420.0, 297.0];
/// Spacing of the grid lines, mm.
const GRID_SPACING_MM: f64 = 50.0;
/// Size of the letters, distance of an object's label from its outline, and least distance of the label's middle from the
/// sheet's left and right edges, mm.
const LETTER_MM: f64 = 5.0;
const LABEL_DISTANCE_MM: f64 = 8.0;
const LABEL_MARGIN_MM: f64 = 60.0;

/// Arguments of `bridge sheet`.
#[derive(Debug, Args)]
pub struct SheetArgs {
    #[command(flatten)]
    robot: RobotArgs,
    /// Number of the combination, from 0.
    #[arg(required_unless_present = "balls")]
    combination: Option<usize>,
    /// Draw the balls of `bridge register` on their marks instead.
    #[arg(long, conflicts_with = "combination")]
    balls: bool,
    /// File for the drawing (SVG); default: recordings/sheet_N.svg, or sheet_balls.svg.
    #[arg(long)]
    out: Option<PathBuf>,
}

/// An object on the sheet.
#[derive(Debug, Serialize, JsonSchema)]
struct PlacedObject {
    /// Name of the object.
    object: String,
    /// Coordinate of its origin in the table frame, m.
    x_m: f64,
    /// Coordinate of its origin in the table frame, m.
    y_m: f64,
    /// Coordinate of its origin in the table frame, m.
    z_m: f64,
    /// Yaw about the vertical from the resting pose, rad.
    turn_rad: f64,
}

/// JSON output of `bridge sheet`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SheetOutput {
    /// File of the drawing (SVG).
    sheet: String,
    /// One entry per object.
    objects: Vec<PlacedObject>,
}

pub fn run(terminal: &Terminal, args: &SheetArgs) -> Result<Option<String>> {
    let robot = args.robot.model()?;
    let (what, title, standing) = match args.combination {
        Some(combination) => {
            let standing = combination_objects(&robot, combination, terminal.seed)?;
            (combination.to_string(), format!("combination {combination}"), standing)
        }
        None => ("balls".to_owned(), "balls of the registration".to_owned(), ball_objects(&robot, terminal.seed)?),
    };
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("recordings/sheet_{what}.svg")));
    let nominal = draw_sheet(&title, &standing);
    ftac_platform::data::write_atomically(&out, nominal.as_bytes())?;
    let placed = |(object, place): &(Arc<ObjectModel>, Isometry3<f64>)| {
        let [x_m, y_m, z_m] = place.translation.vector.into();
        PlacedObject { object: object.name.clone(), x_m, y_m, z_m, turn_rad: yaw(object, place) }
    };
    let sheet = SheetOutput { sheet: display_path(&out), objects: standing.iter().map(placed).collect() };
    let hint = "print it on A3 in full size, check the scale bar, and lay its cross on the table's mark";
    terminal.print(&sheet, &format!("{}: {hint}\n", sheet.sheet))?;
    Ok(None)
}

/// Objects, each with its pose.
type PosedObjects = Vec<(Arc<ObjectModel>, Isometry3<f64>)>;

fn combination_objects(robot: &RobotModel, combination: usize, seed: u64) -> Result<PosedObjects> {
    let bench = make_bench(robot, Scenario::benchmark(), (combination + 1).min(60), seed, true)?;
    let Some(plan) = bench.grasp_pairs.pairs.get(combination) else {
        bail!("COMBINATION: found {combination}, expected 0 to {}", bench.grasp_pairs.pairs.len() - 1);
    };
    let objects = bench.world.models(&plan.objects())?;
    let places = bench.world.object_poses(&objects, &TrialNoise::none());
    Ok(objects.into_iter().zip(places).collect())
}

fn ball_objects(robot: &RobotModel, seed: u64) -> Result<PosedObjects> {
    let bench = make_scene_bench(robot, Scenario::benchmark(), 1, seed, true)?;
    let plan = RegistrationPlan::standard()?;
    let placements = Registrar::new(&bench.world, &plan, &bench.repertoire)?.placements();
    Ok(placements.into_iter().map(|placement| (placement.model, placement.pose)).collect())
}

/// Returns the yaw about the vertical from the object's resting pose, rad.
fn yaw(object: &ObjectModel, place: &Isometry3<f64>) -> f64 {
    (place.rotation * object.rest.inverse()).euler_angles().2
}

/// True for a ball, which nobody can turn wrongly.
fn is_round(object: &ObjectModel) -> bool {
    matches!(object.symmetry, Symmetry::Full)
}

/// Draws the sheet as seen from above, 1:1, with x upwards and y to the left.
fn draw_sheet(title: &str, objects: &PosedObjects) -> String {
    // The cross is on whole centimetres, so that a ruler finds it.
    let middle = |axis: usize| {
        let mean = objects.iter().map(|(_, place)| place.translation.vector[axis]).sum::<f64>() / objects.len() as f64;
        (100.0 * mean).round() / 100.0
    };
    let cross = [middle(0), middle(1)];
    let on_sheet = |point: &Point3<f64>| {
        [0.5 * SHEET_SIZE_MM[0] - 1e3 * (point.y - cross[1]), 0.5 * SHEET_SIZE_MM[1] - 1e3 * (point.x - cross[0])]
    };
    let [width, height] = SHEET_SIZE_MM;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"{LETTER_MM}\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    let mut put = |text: String| svg.push_str(&text);
    let [x, y] = [0.5 * width, 0.5 * height];
    for n in -4..=4 {
        let at = x + f64::from(n) * GRID_SPACING_MM;
        put(format!("<path d=\"M{at} 0V{height}\" stroke=\"#ddd\" stroke-width=\"0.2\"/>\n"));
        let at = y + f64::from(n) * GRID_SPACING_MM;
        put(format!("<path d=\"M0 {at}H{width}\" stroke=\"#ddd\" stroke-width=\"0.2\"/>\n"));
    }
    for (n, (object, place)) in objects.iter().enumerate() {
        let (vertices, triangles, _) = object.shape.triangles();
        let corners: Vec<[f64; 2]> = vertices.iter().map(|vertex| on_sheet(&(*place * vertex))).collect();
        let (mut outline, mut lowest) = (String::new(), 0.0_f64);
        for triangle in &triangles {
            let [a, mut b, mut c] = triangle.map(|corner| corners[corner as usize]);
            // Triangles of upper and lower side must go round the same way: opposite ways cancel.
            if (b[0] - a[0]) * (c[1] - a[1]) < (b[1] - a[1]) * (c[0] - a[0]) {
                std::mem::swap(&mut b, &mut c);
            }
            lowest = lowest.max(a[1]).max(b[1]).max(c[1]);
            outline += &format!("M{:.2} {:.2}L{:.2} {:.2}L{:.2} {:.2}Z", a[0], a[1], b[0], b[1], c[0], c[1]);
        }
        // Every triangle has a border of its own fill colour: together they form the outline.
        put(format!(
            "<path d=\"{outline}\" fill=\"#cfe3f5\" stroke=\"#cfe3f5\" stroke-width=\"0.3\" stroke-linejoin=\"round\"/>\n"
        ));
        let [cx, cy] = on_sheet(&Point3::from(place.translation.vector));
        put(format!(
            "<path d=\"M{} {cy}H{}M{cx} {}V{}\" stroke=\"#036\" stroke-width=\"0.4\"/>\n",
            cx - 4.0,
            cx + 4.0,
            cy - 4.0,
            cy + 4.0
        ));
        let round = is_round(object);
        if !round {
            let front = on_sheet(&(*place * Point3::new(0.03, 0.0, 0.0)));
            put(format!(
                "<path d=\"M{cx:.2} {cy:.2}L{:.2} {:.2}\" stroke=\"#c30\" stroke-width=\"0.6\"/>\n",
                front[0], front[1]
            ));
        }
        let t = place.translation.vector;
        let turned = if round { String::new() } else { format!(", turned {:.0} deg", yaw(object, place).to_degrees()) };
        put(format!(
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}. {}: x {:.3}, y {:.3}{turned}</text>\n",
            cx.clamp(LABEL_MARGIN_MM, width - LABEL_MARGIN_MM),
            lowest + LABEL_DISTANCE_MM,
            n + 1,
            object.name,
            t.x,
            t.y
        ));
    }
    put(format!(
        "<path d=\"M{} {y}H{}M{x} {}V{}\" stroke=\"black\" stroke-width=\"0.4\"/>\n",
        x - 10.0,
        x + 10.0,
        y - 10.0,
        y + 10.0
    ));
    let axis = if objects.iter().all(|(object, _)| is_round(object)) { "" } else { "; red: the object's own x axis" };
    put(format!("<text x=\"{}\" y=\"{}\">cross: x {:.2}, y {:.2} m</text>\n", x + 3.0, y - 3.0, cross[0], cross[1]));
    put(format!(
        "<text x=\"{x}\" y=\"8\" text-anchor=\"middle\">{title}, seen from above; away from the arm (x) is up, y is to the left{axis}</text>\n"
    ));
    put(format!(
        "<path d=\"M10 {0}V{1}H110V{0}\" fill=\"none\" stroke=\"black\" stroke-width=\"0.5\"/>\n",
        height - 14.0,
        height - 10.0
    ));
    put(format!("<text x=\"60\" y=\"{}\" text-anchor=\"middle\">100 mm</text>\n", height - 4.0));
    svg + "</svg>\n"
}
