//! Energy landscape as a picture, and as a page on which each basin shows a grasp.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use ftac_platform::data::write_atomically;
use grasp_analysis::classification::ClassifiedGrasp;
use grasp_analysis::landscape::basins::MappedGrasps;
use hand_model::Hand;
use image::RgbImage;
use maud::html;
use report::plot::Plot;
use world::objects::ObjectModel;

use super::hover;
use super::scene::PageScene;
use super::tree::{self, Leaf};

/// Number of basins shown below the tree.
const SHOWN_BASINS: usize = 12;

/// Text below the heading of the count.
const COUNT_TEXT: &str = "The count grows with the number of sorted grasps, so it depends on this number and is no property of the landscape. The \
                     paper reports 79 basins over six objects and does not state the number of grasps.";
/// Number of basins in the paper.
const PAPER_BASIN_COUNT: f64 = 79.0;

/// Draws the number of basins against the number of sorted grasps, beside the paper's count.
fn growth(counts: &[(usize, usize)]) -> RgbImage {
    let most = counts.last().map_or(1.0, |last| last.0 as f64);
    let ours = counts.iter().map(|(grasps, basins)| [*grasps as f64, *basins as f64]).collect();
    Plot {
        title: "Basins found".into(),
        x: "grasps sorted".into(),
        y: "basins".into(),
        lines: vec![
            ("this study".into(), ours),
            ("paper: 79".into(), vec![[0.0, PAPER_BASIN_COUNT], [most, PAPER_BASIN_COUNT]]),
        ],
    }
    .draw()
}

/// Writes `landscape.svg`, `growth.png` and `landscape.html` into `folder`. `objects` are in the order of the
/// classification.
pub fn write(folder: &Path, (hand, objects): (&Hand, &[Arc<ObjectModel>]), found: &MappedGrasps<'_>) -> Result<()> {
    let basins = &found.map.basins;
    let shown: Vec<&ClassifiedGrasp> = basins.iter().map(|basin| found.lowest(basin)).collect();
    let leaves: Vec<Leaf> = basins
        .iter()
        .enumerate()
        .map(|(n, basin)| {
            let (members, category) = (basin.members.len(), found.majority(basin));
            let text = format!(
                "basin {n}: {members} grasps, mostly {}; shown {} ({})",
                category.name(),
                shown[n].id,
                found.classification.type_name(shown[n])
            );
            Leaf { members, category, grasp: n, text }
        })
        .collect();
    let title = format!("{} basins of {} grasps", basins.len(), found.minima.len());
    let nominal = tree::svg(found.tree, &leaves, &title);
    write_atomically(&folder.join("landscape.svg"), nominal.0.as_bytes())?;
    report::picture::save(&growth(&found.growth()), &folder.join("growth.png"))?;
    let mut largest: Vec<usize> = (0..leaves.len()).collect();
    largest.sort_by_key(|n| (std::cmp::Reverse(leaves[*n].members), *n));
    largest.truncate(SHOWN_BASINS);
    let gallery: Vec<(usize, String)> = largest.iter().map(|n| (*n, leaves[*n].text.clone())).collect();
    let introduction = "Circles are basins: sized by their number of grasps, coloured by their majority's broad type, at the height \
                        of their lowest energy. Bars join basins at the energy over which one leads to the other. Point at a \
                        circle to see a grasp of it. Below: the largest basins.";
    let body = html! {
        div style="overflow-x:auto" { (nominal) }
        h2 { "Number of basins" }
        p { (COUNT_TEXT) }
        img src="growth.png" alt="basins over grasps" style="max-width:100%";
        h2 { "The largest basins" }
        (hover::gallery(&gallery))
    };
    let page = hover::page(&title, introduction, &body, &PageScene::from_grasps(hand, objects, shown))?;
    Ok(write_atomically(&folder.join("landscape.html"), page.as_bytes())?)
}
