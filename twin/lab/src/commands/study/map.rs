//! `ftac grasps map`: contact maps of all grasps on one sheet, and the boundary between power and precision grasps.

use anyhow::{Context, Result, ensure};
use ftac::lab::arguments::grasps::MapArgs;
use ftac::terminal::{Made, Outcome, Terminal};
use ftac_platform::data::write_whole;
use grasp_analysis::grasp_map::{Figures, GraspMaps, MapSettings, check_both_classes, contact_maps};
use lab::study_pages;

use super::source::Source;

/// Runs `ftac grasps map`.
pub fn run(terminal: &Terminal, args: &MapArgs) -> Outcome {
    terminal.finish(make(terminal, args)?)
}

/// Computes the maps and the boundary.
pub fn make(terminal: &Terminal, args: &MapArgs) -> Result<Made<Figures>> {
    ensure!(
        args.n >= 4 && args.seeds > 0,
        "--n and --seeds: found {} and {}, expected at least 4 and 1",
        args.n,
        args.seeds
    );
    let Source { hand, objects, classification } = Source::read(&args.grasps.paths)?;
    // Checks first what would otherwise fail only at the end.
    check_both_classes(&classification)?;
    std::fs::create_dir_all(&args.out).with_context(|| format!("--out {}", args.out.display()))?;
    let distance = |object: usize, point: &_| objects[object].shape.signed_distance(point).0;
    let contacts = contact_maps(&hand, &classification, distance, &terminal.progress());
    let settings = MapSettings { most: args.n, maps: args.seeds, seed: terminal.seed };
    let found = GraspMaps::of(&classification, &contacts, &settings)?;
    study_pages::map::write(&args.out, (&hand, &objects), &classification, &found.maps[0])?;
    let answer = found.figures(&classification, terminal.seed);
    write_whole(&args.out.join("map.json"), serde_json::to_string_pretty(&answer)?.as_bytes())?;
    let text = found.text(classification.grasps.len());
    let text = format!("{text}{}/map.html, map.svg, map.json\n", args.out.display());
    Ok(Made { json: answer, text, shortfall: None })
}
