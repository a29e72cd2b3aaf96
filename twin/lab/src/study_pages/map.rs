//! Map of grasps as SVG: one dot per grasp, coloured by broad type, over the two sides of the boundary.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use dexterous_grasping::taxonomy::Category;
use ftac_platform::data::write_atomically;
use grasp_analysis::classification::{Classification, ClassifiedGrasp};
use grasp_analysis::grasp_map::GraspMap;
use hand_model::Hand;
use maud::{Markup, html};
use world::objects::ObjectModel;

use super::hover;
use super::scene::PageScene;
use super::tree::color;

/// One grasp on the map.
#[derive(Debug, Clone)]
pub struct MapDot {
    /// Coordinates on the map.
    pub at: [f64; 2],
    pub category: Category,
    /// Index in the scene.
    pub grasp: usize,
    /// Caption.
    pub text: String,
}

const MAP_SIZE: f64 = 720.0;
const TOP: f64 = 56.0;
/// Cells of the boundary's shading along each side.
const BOUNDARY_CELLS: usize = 90;

/// Draws the map; `power` is true for coordinates on the power side of the boundary.
pub fn svg(dots: &[MapDot], power: impl Fn([f64; 2]) -> bool, title: &str) -> Markup {
    let reach = dots.iter().flat_map(|dot| dot.at).fold(1e-9, |most: f64, x| most.max(x.abs())) * 1.06;
    let place = |at: [f64; 2]| [0.5 * MAP_SIZE * (1.0 + at[0] / reach), TOP + 0.5 * MAP_SIZE * (1.0 - at[1] / reach)];
    let cell = MAP_SIZE / BOUNDARY_CELLS as f64;
    let mut shading = Vec::new();
    for row in 0..BOUNDARY_CELLS {
        // Consecutive cells of one side become one rectangle.
        let side = |column: usize| {
            let at = |k: usize| 2.0 * (k as f64 + 0.5) / BOUNDARY_CELLS as f64 - 1.0;
            power([reach * at(column), -reach * at(row)])
        };
        let mut start = 0;
        while start < BOUNDARY_CELLS {
            let own = side(start);
            let end = (start + 1..BOUNDARY_CELLS).find(|column| side(*column) != own).unwrap_or(BOUNDARY_CELLS);
            shading.push((start as f64 * cell, TOP + row as f64 * cell, (end - start) as f64 * cell + 0.3, own));
            start = end;
        }
    }
    let tenth = |x: f64| format!("{x:.1}");
    html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (MAP_SIZE) " " (MAP_SIZE + TOP + 8.0) } font-family="system-ui,Arial,sans-serif" font-size="12" {
            rect width=(MAP_SIZE) height=(MAP_SIZE + TOP + 8.0) fill="#fff" {}
            text x="8" y="20" font-size="15" font-weight="600" { (title) }
            @for (x, y, width, own) in shading {
                rect x=(tenth(x)) y=(tenth(y)) width=(tenth(width)) height=(tenth(cell + 0.3)) fill=(if own { "#f8e5e2" } else { "#e2f1e8" }) {}
            }
            @for MapDot { at, category, grasp, text } in dots {
                @let [x, y] = place(*at).map(tenth);
                circle data-grasp=(grasp) data-text=(text) cx=(x) cy=(y) r="4" fill=(color(*category)) fill-opacity=".85" stroke="#fff" stroke-width=".6" {
                    title { (text) }
                }
            }
            @for (k, category) in Category::ALL.into_iter().enumerate() {
                @let at = 14.0 + 150.0 * k as f64;
                circle cx=(at) cy="40" r="6" fill=(color(category)) {}
                text x=(at + 11.0) y="44" { (category.name()) " " (dots.iter().filter(|dot| dot.category == category).count()) }
            }
        }
    }
}

/// Writes `map.svg` and `map.html` into `folder`; on the page grasps appear in 3D under the mouse. `objects` are in the
/// order of the classification.
pub fn write(
    folder: &Path,
    (hand, objects): (&Hand, &[Arc<ObjectModel>]),
    classification: &Classification,
    map: &GraspMap,
) -> Result<()> {
    let grasps: Vec<&ClassifiedGrasp> = map.sampled.iter().map(|n| &classification.grasps[*n]).collect();
    let dots: Vec<MapDot> = grasps
        .iter()
        .enumerate()
        .map(|(n, grasp)| {
            let doubt = if grasp.decision.ambiguous { " (ambiguous)" } else { "" };
            let text = format!("{}: {}{doubt}", grasp.id, classification.type_name(grasp));
            MapDot { at: map.positions[n], category: classification.category(grasp), grasp: n, text }
        })
        .collect();
    let title = format!("Contact maps of {} grasps", dots.len());
    let picture = svg(&dots, |at| map.boundary.is_power(&at), &title);
    write_atomically(&folder.join("map.svg"), picture.0.as_bytes())?;
    let scene = PageScene::from_grasps(hand, objects, grasps);
    let introduction = "Each dot is a grasp; neighbours touch with the same parts of the hand. Shading: the side of the boundary \
                        between power and precision. Point at a dot to see the grasp.";
    let page = hover::page(&title, introduction, &html! { div style="max-width:900px" { (picture) } }, &scene)?;
    Ok(write_atomically(&folder.join("map.html"), page.as_bytes())?)
}
