//! `ftac grasps landscape`: maps the energy landscape of several objects' grasps by attraction-diffusion, as a tree.
//!
//! Every verified grasp cools to its local minimum. The attraction is calibrated to the metastability threshold of
//! pairs of minima. Minima are then sorted into basins, and barriers are measured. Every step is journalled, so that
//! the same command resumes after an interruption.

use anyhow::{Context, Result, bail, ensure};
use dexterous_grasping::synthesis::energy::{EnergyWeights, GraspEnergy};
use dexterous_grasping::synthesis::surface::HandSurface;
use ftac::lab::arguments::grasps::LandscapeArgs;
use ftac::terminal::{CommandOutput, Outcome, Terminal};
use ftac_platform::data::write_atomically;
use grasp_analysis::classification::Classification;
use grasp_analysis::landscape::attraction::AttractionSettings;
use grasp_analysis::landscape::basins::{LandscapeFigures, MappedGrasps};
use grasp_analysis::landscape::calibration::{CalibrationRequest, INITIAL_PULL, PullCalibration};
use grasp_analysis::landscape::disconnectivity::tree;
use grasp_analysis::landscape::exploration;
use grasp_analysis::landscape::grasps::{GraspLandscape, GraspState};
use grasp_verification::synthesis::subject::PreparedObject;
use lab::study_pages;

use super::source::GraspSource;

/// Number of points on the hand's surface: fewer than in synthesis, whose energy is used here.
const SURFACE_POINTS: usize = 1000;

/// Runs `ftac grasps landscape`.
pub fn run(terminal: &Terminal, args: &LandscapeArgs) -> Outcome {
    terminal.print_result(make(terminal, args)?)
}

/// Maps the tree of basins and barriers.
pub fn make(terminal: &Terminal, args: &LandscapeArgs) -> Result<CommandOutput<LandscapeFigures>> {
    let positive = |x: f64| x.is_finite() && x > 0.0;
    ensure!(
        args.each > 0 && positive(args.temperature) && args.pull.is_none_or(positive),
        "--each, --temperature, --pull: found {}, {}, {:?}, expected positive numbers",
        args.each,
        args.temperature,
        args.pull
    );
    let source = GraspSource::read(&args.grasps.paths)?;
    let classification = &source.classification;
    let chosen = choose_grasps(classification, args)?;
    std::fs::create_dir_all(&args.out).with_context(|| format!("--out {}", args.out.display()))?;
    let progress = terminal.progress();
    let subjects = args.objects.iter().map(|name| PreparedObject::from_set(name)).collect::<Result<Vec<_>>>()?;
    let surface = HandSurface::new(&source.hand, SURFACE_POINTS);
    let energies = subjects
        .iter()
        .map(|subject| GraspEnergy::new(&source.hand, &surface, &subject.field, EnergyWeights::default(), None))
        .collect();
    let landscape = GraspLandscape::new(&source.hand, energies);
    let minima = exploration::find_minima(&landscape, classification, &chosen, args.temperature, terminal.seed);
    ensure!(
        minima.len() >= 2,
        "--objects: found {} grasps with two links that touch, expected at least 2",
        minima.len()
    );
    let states: Vec<GraspState> = minima.iter().map(|minimum| minimum.state.clone()).collect();
    let subject = format!("{} from {} grasps, temperature {}", args.objects.join(","), minima.len(), args.temperature);
    let attraction = exploration::attraction(INITIAL_PULL, args.temperature);
    let calibration = match args.pull {
        Some(_) => PullCalibration::empty(&subject),
        None => {
            let question = CalibrationRequest { subject: &subject, attraction, seed: terminal.seed };
            PullCalibration::resume(&landscape, &states, &question, &args.out.join("calibration.json"), &progress)?
        }
    };
    let Some(pull) = args.pull.or(calibration.pull()) else {
        bail!("--pull: no chain arrived in the calibration even at {INITIAL_PULL}; give a pull");
    };
    let plan = exploration::mapping_parameters(AttractionSettings { pull, ..attraction }, terminal.seed, subject);
    let map = exploration::explore(&landscape, &states, plan.clone(), &args.out.join("journal.jsonl"), &progress)?;
    let few = |n: usize| &states[..n.clamp(2, states.len())];
    let sweep = args.sweep.map(|n| exploration::sweep_basins(&landscape, few(n), &plan, &progress)).transpose()?;
    let energies: Vec<f64> = map.basins.iter().map(|basin| basin.energy).collect();
    let tree = tree(&energies, &map.edges());
    let found = MappedGrasps { classification, minima: &minima, map: &map, tree: &tree };
    let answer = found.figures(calibration, sweep);
    study_pages::landscape::write(&args.out, (&source.hand, &source.objects), &found)?;
    write_atomically(&args.out.join("landscape.json"), serde_json::to_string_pretty(&answer)?.as_bytes())?;
    let files = format!("{}/landscape.html, landscape.svg, growth.png, landscape.json", args.out.display());
    let text = format!("{}{files}\n", answer.text());
    Ok(CommandOutput { json: answer, text, shortfall: None })
}

/// Returns pairs (index of the object on the command line, grasp), with the objects in turn.
fn choose_grasps(classification: &Classification, args: &LandscapeArgs) -> Result<Vec<(usize, usize)>> {
    let mut by_object = Vec::new();
    for (n, name) in args.objects.iter().enumerate() {
        let is_of = |k: &usize| classification.object(&classification.grasps[*k]) == name;
        let own: Vec<usize> = (0..classification.grasps.len()).filter(is_of).take(args.each).collect();
        let known = classification.objects.join(", ");
        ensure!(!own.is_empty(), "--objects: found no grasp of `{name}`, expected some of {known}");
        ensure!(!args.objects[..n].contains(name), "--objects: found `{name}` twice, expected each once");
        by_object.push(own);
    }
    Ok(exploration::interleave(&by_object))
}
