//! `ftac grasps map`: contact maps of all grasps on one sheet, and the boundary between power and precision grasps.

use anyhow::{Context, Result, ensure};
use ftac::lab::arguments::grasps::MapArgs;
use ftac::terminal::{CommandOutput, Outcome, Terminal};
use ftac_platform::data::write_atomically;
use grasp_analysis::grasp_map::{GraspMaps, MapFigures, MapSettings, check_both_classes, contact_maps};
use lab::study_pages;

use super::source::GraspSource;

/// Runs `ftac grasps map`.
pub fn run(terminal: &Terminal, args: &MapArgs) -> Outcome {
    terminal.print_result(make(terminal, args)?)
}

/// Computes the maps and the boundary.
pub fn make(terminal: &Terminal, args: &MapArgs) -> Result<CommandOutput<MapFigures>> {
    ensure!(
        args.n >= 4 && args.seeds > 0,
        "--n and --seeds: found {} and {}, expected at least 4 and 1",
        args.n,
        args.seeds
    );
    let GraspSource { hand, objects, classification } = GraspSource::read(&args.grasps.paths)?;
    // Checks first for errors that would otherwise appear only at the end.
    check_both_classes(&classification)?;
    std::fs::create_dir_all(&args.out).with_context(|| format!("--out {}", args.out.display()))?;
    let distance = |object: usize, point: &_| objects[object].shape.signed_distance(point).0;
    let contacts = contact_maps(&hand, &classification, distance, &terminal.progress());
    let settings = MapSettings { max_grasps: args.n, maps: args.seeds, seed: terminal.seed };
    let found = GraspMaps::compute(&classification, &contacts, &settings)?;
    study_pages::map::write(&args.out, (&hand, &objects), &classification, &found.maps[0])?;
    let answer = found.figures(&classification, terminal.seed);
    write_atomically(&args.out.join("map.json"), serde_json::to_string_pretty(&answer)?.as_bytes())?;
    let text = found.text(classification.grasps.len());
    let text = format!("{text}{}/map.html, map.svg, map.json\n", args.out.display());
    Ok(CommandOutput { json: answer, text, shortfall: None })
}
