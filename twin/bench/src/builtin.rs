//! Built-in data of the program (repertoire, plans, calibrations and networks), and the bench that they make of a
//! scenario.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use control::perception::KnownObject;
use control::uncertainty::Uncertainty;
use grasp_verification::cache::Cache;
use grasp_verification::plan::Plan;
use grasp_verification::simulated_world::World;
use grasp_verification::{ball_sizes, preparation};
use hand_model::parameters::{Configuration, HandParameters};
use hand_model::robot::TactileImage;
use hand_model::{Hand, RobotModel};
use plant::Individual;
use plant::RobotIndividual;
use scenarios::Scenario;
use scenarios::effects::Effect;
use sim::tactile::TactileBoard;
use tactile_perception::{OwnHandOptions, PhotometricCalibration, TouchPipeline};

use crate::journal::RunRequest;
use crate::trial::Bench;

/// Combinations of a benchmark, as in the paper.
pub const COMBINATIONS: usize = 60;

/// Hand unit that runs the trials.
pub const HAND_UNIT: u64 = 7;
/// Hand unit that photometric stereo was calibrated on.
pub const CALIBRATION_UNIT: u64 = 1;

/// Largest change of the cameras' brightness that perception treats as drift, as a share. The longest trials take two
/// minutes, in which cameras that drift by several per cent a minute come near it.
const MOST_DRIFT: f32 = 0.15;

/// Returns the photometric models that come with the program.
pub fn builtin_calibration() -> Result<PhotometricCalibration> {
    serde_json::from_str(include_str!("../data/calibration.json")).context("data/calibration.json")
}

/// Returns the photometric models of a robot's pads: those of its own calibration, or those that come with the program.
///
/// # Errors
/// Fails for a pad whose size differs from that of its configuration in the built-in hand and that has no calibration
/// of its own.
pub fn calibration_of(robot: &RobotModel) -> Result<PhotometricCalibration> {
    if let Some((text, name)) = robot.calibration()? {
        return parse_pads(&robot.hand, text, &name);
    }
    let (calibration, known) = (builtin_calibration()?, &HandParameters::ftac().configuration);
    for pad in &robot.hand.pads {
        let same = |it: &Configuration| (it.h - pad.h).abs() < 1e-6 && (it.w - pad.w).abs() < 1e-6;
        if !known.get(&pad.configuration.to_string()).is_some_and(same) {
            bail!(
                "{}: calibration: found none, expected a file: the built-in calibration has no pad of configuration {} with {:.1} x {:.1} mm \
                 (pad {}); `ftac touch train --robot-model FILE --out pads.json` makes one",
                robot.file().display(),
                pad.configuration,
                1e3 * pad.h,
                1e3 * pad.w,
                pad.name
            );
        }
    }
    Ok(calibration)
}

/// Creates the perception of a simulated robot from its calibration and images of its untouched pads.
pub fn simulated_touch(robot: &RobotModel, backgrounds: Vec<Arc<TactileImage>>) -> Result<TouchPipeline> {
    let mut pipeline = TouchPipeline::new(&robot.hand, calibration_of(robot)?, backgrounds)?;
    // The engine's covers are rigid, and images are made from its forces: an object that only touches shows as pressed
    // in.
    pipeline.pose.sinking = 0.0;
    Ok(pipeline)
}

/// Parses a calibration of every pad of `hand` from the text of a file; `path` is used in errors.
pub fn parse_pads(hand: &Hand, text: &str, path: &Path) -> Result<PhotometricCalibration> {
    let calibration = PhotometricCalibration::parse(text, path)?;
    for pad in &hand.pads {
        calibration.model(pad.configuration).with_context(|| path.display().to_string())?;
    }
    Ok(calibration)
}

/// Replaces the calibration by which a bench's perception reads images with that of a file's text. Without a text
/// nothing changes.
pub fn read_pads_by(bench: &mut Bench, text: Option<&str>, path: &Path) -> Result<()> {
    if let Some(text) = text {
        let calibration = parse_pads(&bench.world.cell.robot.hand, text, path)?;
        bench.pipeline = bench.pipeline.with_calibration(calibration);
    }
    Ok(())
}

/// Gives perception the known properties of the scenario's hand: cable losses, and how far objects sink into pads.
pub fn know_hand(pipeline: &mut TouchPipeline, world: &World) {
    pipeline.pose.cables = world.known_cable_losses();
    if world.scenario.effects.gel.is_some() {
        pipeline.pose.sinking = 1.0;
    }
}

/// Prepares everything that trials of a robot and of the scenario's first `combos` combinations share, or of as many
/// combinations as are feasible.
pub fn make_bench(robot: &RobotModel, scenario: Scenario, combos: usize, seed: u64, quiet: bool) -> Result<Bench> {
    let mut bench = make_scenes(robot, scenario, combos, seed, quiet)?;
    let names: BTreeSet<&str> = bench.plans.plans.iter().flat_map(Plan::objects).collect();
    bench.known = names
        .into_iter()
        .map(|name| Ok((name.to_owned(), KnownObject::new(bench.world.object(name)?))))
        .collect::<Result<BTreeMap<_, _>>>()?;
    let disturbance = bench.world.scenario.disturbance.clone();
    if let Some(sweep) = &disturbance.size_sweep {
        let balls = ball_sizes::add(sweep, &mut bench.world, &mut bench.repertoire)?;
        bench.known.extend(balls.into_iter().map(|ball| (ball.name.clone(), KnownObject::new(ball))));
    }
    if !disturbance.disabled().is_empty() {
        bench.do_without(disturbance.disabled())?;
    }
    Ok(bench)
}

/// Prepares the bench of a run, with all settings of the request for robot, scenario and controller, except the device
/// that renders images.
pub fn bench_of(request: &RunRequest, quiet: bool) -> Result<Bench> {
    let model = request.robot_model(Path::new("--individual"))?;
    let mut bench = make_bench(&model, request.scenario()?, request.combos, request.seed, quiet)?;
    request.places.set_up(&mut bench.world)?;
    read_pads_by(&mut bench, request.pads.as_deref(), Path::new("--pads"))?;
    if let Some(number) = request.plant {
        hide_plant(&mut bench, number)?;
    }
    bench.foresee(request.foresees);
    expect_errors(&mut bench, request.uncertainty.as_deref(), Path::new("--uncertainty"), &request.robot)?;
    Ok(bench)
}

/// Prepares a bench without perception of objects and without the scenario's disturbances, for scenes in which no
/// policy of this program decides.
pub fn make_scenes(robot: &RobotModel, scenario: Scenario, combos: usize, seed: u64, quiet: bool) -> Result<Bench> {
    // Plans are made for the nominal places; a spread of the layout does not change them.
    let benchmark = Scenario::benchmark();
    let planned = |scenario: &Scenario| (scenario.layout.first, scenario.layout.second, scenario.start);
    let builtin = grasp_verification::builtin::fits(robot)?
        && scenario.object.is_empty()
        && scenario.first == benchmark.first
        && scenario.second == benchmark.second
        && scenario.third.is_empty()
        && planned(&scenario) == planned(&benchmark);
    let mut bench = make_playground(robot, scenario, seed)?;
    if !builtin || combos > bench.plans.plans.len() {
        let prepared = preparation::prepare(&bench.world, combos, seed, &Cache::standard()?, quiet)?;
        (bench.repertoire, bench.plans) = (prepared.repertoire, prepared.plans);
        (bench.notes, bench.left_out) = (prepared.notes, prepared.left_out);
    }
    bench.plans.plans.truncate(combos);
    Ok(bench)
}

/// Prepares a bench for scenes that need no grasp. None is searched for: repertoire and plans are those of the built-in
/// robot.
///
/// # Errors
/// Fails for a pad without a calibration, or a scenario out of the arm's reach.
pub fn make_playground(robot: &RobotModel, scenario: Scenario, seed: u64) -> Result<Bench> {
    let world = World::new(robot, scenario)?;
    let board = TactileBoard::unit(&world.cell.robot.hand, HAND_UNIT);
    let mut pipeline = simulated_touch(&world.cell.robot, board.backgrounds())?;
    if let Some(pads) = world.scenario.effects.pads {
        pipeline.stereo.most_drift = MOST_DRIFT;
        pipeline.own_hand = pads.self_contact.then(OwnHandOptions::default);
    }
    know_hand(&mut pipeline, &world);
    Ok(Bench {
        world,
        repertoire: grasp_verification::builtin::repertoire()?,
        plans: grasp_verification::builtin::plans()?,
        board,
        pipeline,
        known: BTreeMap::new(),
        uncertainty: Uncertainty::standard(),
        seed,
        profile: Arc::default(),
        twin: None,
        outlasts_faults: false,
        own: None,
        notes: Vec::new(),
        left_out: Vec::new(),
        intact: None,
    })
}

/// Sets the errors that the controller of a bench expects on the body `robot`: those of a file's text, or without one
/// those of the robot that comes with the program. For a simulated robot whose scenario has no errors it expects none,
/// as a laboratory would measure.
pub fn expect_errors(bench: &mut Bench, text: Option<&str>, path: &Path, robot: &str) -> Result<()> {
    if let Some(text) = text {
        bench.uncertainty = Uncertainty::parse(text, path)?;
    } else if robot == "sim" && bench.world.scenario.is_exact() {
        bench.uncertainty = Uncertainty::EXACT;
    }
    Ok(())
}

/// Makes the body of a bench individual `number` of the robots built from the drawing, unknown to the control stack.
/// The cameras of its pads stay those of the bench.
pub fn hide_plant(bench: &mut Bench, number: u64) -> Result<()> {
    let nominal = bench.world.cell.robot.nominal()?;
    bench.world.plant = Some(RobotIndividual::draw(&nominal, number).robot(&nominal));
    Ok(())
}

/// Prepares a bench whose robot is individual `number` of those built from the drawing, with objects and tactile
/// cameras of its own. Number 0 is the robot as drawn, among objects like their models. Emulated robots are made of it.
pub fn make_individual(
    number: u64,
    nominal: &RobotModel,
    scenario: Scenario,
    combos: usize,
    seed: u64,
    quiet: bool,
) -> Result<Bench> {
    let Some(cameras) = RobotIndividual::cameras(number) else {
        return make_scenes(nominal, scenario, combos, seed, quiet);
    };
    let own = RobotIndividual::draw(nominal, number);
    let mut bench = make_scenes(&own.robot(nominal), scenario, combos, seed, quiet)?;
    bench.board = TactileBoard::unit(&bench.world.cell.robot.hand, cameras);
    let spread = bench.world.scenario.effects.objects;
    let models: Vec<_> = bench.world.objects.iter().cloned().collect();
    for model in &models {
        // An object that has fallen is the same individual.
        let own_name = |name: &str| name.split('/').next().map(str::to_owned);
        let place = models.iter().position(|other| own_name(&other.name) == own_name(&model.name)).unwrap_or(0);
        let mut rng = Effect::Objects.stream(number, place, 0);
        let one = spread.map_or(Individual::AS_MODELLED, |spread| spread.draw(&mut rng));
        let real = Individual { friction: one.friction * own.pad_friction(), ..one }.of(model)?;
        bench.world.objects.insert((*real).clone());
    }
    Ok(bench)
}
