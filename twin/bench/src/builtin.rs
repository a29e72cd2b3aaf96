//! Built-in data of the program (repertoire, grasp pairs, calibrations and networks), and the benches made from it and
//! a scenario.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use control::perception::KnownObject;
use control::uncertainty::Uncertainty;
use grasp_verification::cache::ResultCache;
use grasp_verification::grasp_pair::GraspPair;
use grasp_verification::simulated_world::SimulatedWorld;
use grasp_verification::{ball_sizes, preparation};
use hand_model::parameters::{HandParameters, SensorConfiguration};
use hand_model::robot::TactileImage;
use hand_model::{Hand, RobotModel};
use plant::ObjectInstance;
use plant::RobotInstance;
use scenarios::Scenario;
use scenarios::effects::Effect;
use sim::tactile::TactileBoard;
use tactile_perception::{PhotometricCalibration, SelfContactOptions, TouchPipeline};

use crate::journal::RunRequest;
use crate::trial::Bench;

/// Combinations of a benchmark, as in the paper.
pub const COMBINATION_COUNT: usize = 60;

/// Hand unit that runs the trials.
pub const HAND_UNIT: u64 = 7;
/// Hand unit of the photometric stereo calibration.
pub const CALIBRATION_UNIT: u64 = 1;

/// Largest change of the cameras' brightness that perception treats as drift, as a share. The longest trials take two
/// minutes; cameras that drift by several per cent a minute come near it.
const MAX_BRIGHTNESS_DRIFT: f32 = 0.15;

/// Returns the photometric models that come with the program.
pub fn builtin_calibration() -> Result<PhotometricCalibration> {
    serde_json::from_str(include_str!("../data/calibration.json")).context("data/calibration.json")
}

/// Returns the photometric models of a robot's pads: those of its own calibration, or the built-in ones.
///
/// # Errors
/// Fails for a pad whose size differs from that of its configuration in the built-in hand and that has no own
/// calibration.
pub fn robot_calibration(robot: &RobotModel) -> Result<PhotometricCalibration> {
    if let Some((text, name)) = robot.calibration()? {
        return parse_calibration(&robot.hand, text, &name);
    }
    let (calibration, known) = (builtin_calibration()?, &HandParameters::ftac().configuration);
    for pad in &robot.hand.pads {
        let same = |it: &SensorConfiguration| (it.h - pad.h).abs() < 1e-6 && (it.w - pad.w).abs() < 1e-6;
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
pub fn simulated_touch_pipeline(robot: &RobotModel, backgrounds: Vec<Arc<TactileImage>>) -> Result<TouchPipeline> {
    let mut pipeline = TouchPipeline::new(&robot.hand, robot_calibration(robot)?, backgrounds)?;
    // The engine's covers are rigid and images are made from its forces, so an object in mere contact appears pressed
    // in.
    pipeline.pose.penetration_share = 0.0;
    Ok(pipeline)
}

/// Parses a calibration of every pad of `hand` from the text of a file; `path` is used in errors.
pub fn parse_calibration(hand: &Hand, text: &str, path: &Path) -> Result<PhotometricCalibration> {
    let calibration = PhotometricCalibration::parse(text, path)?;
    for pad in &hand.pads {
        calibration.model(pad.configuration).with_context(|| path.display().to_string())?;
    }
    Ok(calibration)
}

/// Replaces the calibration with which a bench's perception reads images by that of a file's text. Changes nothing
/// without a text.
pub fn replace_calibration(bench: &mut Bench, text: Option<&str>, path: &Path) -> Result<()> {
    if let Some(text) = text {
        let calibration = parse_calibration(&bench.world.cell.robot.hand, text, path)?;
        bench.pipeline = bench.pipeline.with_calibration(calibration);
    }
    Ok(())
}

/// Sets the known properties of the scenario's hand in the perception: cable losses and penetration of objects into
/// pads.
pub fn apply_hand_properties(pipeline: &mut TouchPipeline, world: &SimulatedWorld) {
    pipeline.pose.cables = world.known_cable_losses();
    if world.scenario.effects.gel.is_some() {
        pipeline.pose.penetration_share = 1.0;
    }
}

/// Prepares the data shared by all trials of a robot and of the scenario's first `combos` combinations, or of as many
/// as are feasible.
pub fn make_bench(robot: &RobotModel, scenario: Scenario, combos: usize, seed: u64, quiet: bool) -> Result<Bench> {
    let mut bench = make_scene_bench(robot, scenario, combos, seed, quiet)?;
    let names: BTreeSet<&str> = bench.grasp_pairs.pairs.iter().flat_map(GraspPair::objects).collect();
    bench.known_objects = names
        .into_iter()
        .map(|name| Ok((name.to_owned(), KnownObject::new(bench.world.object(name)?))))
        .collect::<Result<BTreeMap<_, _>>>()?;
    let disturbance = bench.world.scenario.disturbance.clone();
    if let Some(sweep) = &disturbance.size_sweep {
        let balls = ball_sizes::add_balls(sweep, &mut bench.world, &mut bench.repertoire)?;
        bench.known_objects.extend(balls.into_iter().map(|ball| (ball.name.clone(), KnownObject::new(ball))));
    }
    if !disturbance.disabled().is_empty() {
        bench.disable_digits(disturbance.disabled())?;
    }
    Ok(bench)
}

/// Prepares the bench of a run, with all settings of the request for robot, scenario and controller, except the device
/// that renders images.
pub fn bench_from_request(request: &RunRequest, quiet: bool) -> Result<Bench> {
    let model = request.robot_model(Path::new("--instance"))?;
    let mut bench = make_bench(&model, request.scenario()?, request.combos, request.seed, quiet)?;
    request.places.apply_to(&mut bench.world)?;
    replace_calibration(&mut bench, request.pads.as_deref(), Path::new("--pads"))?;
    if let Some(number) = request.plant_instance {
        set_plant_instance(&mut bench, number)?;
    }
    bench.set_look_ahead(request.looks_ahead);
    set_expected_errors(&mut bench, request.uncertainty.as_deref(), Path::new("--uncertainty"), &request.robot)?;
    Ok(bench)
}

/// Prepares a bench without perception of objects and without the scenario's disturbances, for scenes in which no
/// policy of this program decides.
pub fn make_scene_bench(
    robot: &RobotModel,
    scenario: Scenario,
    combos: usize,
    seed: u64,
    quiet: bool,
) -> Result<Bench> {
    // Grasp pairs are made for the nominal poses; random offsets of the layout do not change them.
    let benchmark = Scenario::benchmark();
    let planned = |scenario: &Scenario| (scenario.layout.first, scenario.layout.second, scenario.start);
    let builtin = grasp_verification::builtin::fits_robot(robot)?
        && scenario.object.is_empty()
        && scenario.first == benchmark.first
        && scenario.second == benchmark.second
        && scenario.third.is_empty()
        && planned(&scenario) == planned(&benchmark);
    let mut bench = make_graspless_bench(robot, scenario, seed)?;
    if !builtin || combos > bench.grasp_pairs.pairs.len() {
        let prepared = preparation::prepare(&bench.world, combos, seed, &ResultCache::user_cache()?, quiet)?;
        (bench.repertoire, bench.grasp_pairs) = (prepared.repertoire, prepared.pairs);
        (bench.notes, bench.left_out) = (prepared.notes, prepared.left_out);
    }
    bench.grasp_pairs.pairs.truncate(combos);
    Ok(bench)
}

/// Prepares a bench for scenes without grasps. None is searched for: repertoire and grasp pairs are those of the
/// built-in robot.
///
/// # Errors
/// Fails for a pad without a calibration, or a scenario out of the arm's reach.
pub fn make_graspless_bench(robot: &RobotModel, scenario: Scenario, seed: u64) -> Result<Bench> {
    let world = SimulatedWorld::new(robot, scenario)?;
    let board = TactileBoard::unit(&world.cell.robot.hand, HAND_UNIT);
    let mut pipeline = simulated_touch_pipeline(&world.cell.robot, board.backgrounds())?;
    if let Some(pads) = world.scenario.effects.pads {
        pipeline.stereo.max_drift = MAX_BRIGHTNESS_DRIFT;
        pipeline.self_contact = pads.self_contact.then(SelfContactOptions::default);
    }
    apply_hand_properties(&mut pipeline, &world);
    Ok(Bench {
        world,
        repertoire: grasp_verification::builtin::repertoire()?,
        grasp_pairs: grasp_verification::builtin::grasp_pairs()?,
        cameras: board,
        pipeline,
        known_objects: BTreeMap::new(),
        uncertainty: Uncertainty::standard(),
        seed,
        profile: Arc::default(),
        rollout_model: None,
        continues_after_faults: false,
        external_policy: None,
        notes: Vec::new(),
        left_out: Vec::new(),
        intact_grasps: None,
    })
}

/// Sets the errors that the controller of a bench expects on the backend `robot`: those of a file's text, or without
/// one the built-in ones. On a simulated robot whose scenario has no errors, it expects none, as a laboratory would
/// measure.
pub fn set_expected_errors(bench: &mut Bench, text: Option<&str>, path: &Path, robot: &str) -> Result<()> {
    if let Some(text) = text {
        bench.uncertainty = Uncertainty::parse(text, path)?;
    } else if robot == "sim" && bench.world.scenario.is_ideal() {
        bench.uncertainty = Uncertainty::EXACT;
    }
    Ok(())
}

/// Makes the bench's backend robot instance `number`, unknown to the control stack. The cameras of its pads stay those
/// of the bench.
pub fn set_plant_instance(bench: &mut Bench, number: u64) -> Result<()> {
    let nominal = bench.world.cell.robot.nominal()?;
    bench.world.plant = Some(RobotInstance::sample(&nominal, number).apply_to_robot(&nominal));
    Ok(())
}

/// Prepares a bench whose robot is instance `number`, with its own objects and tactile cameras. Number 0 is the nominal
/// robot, among objects equal to their models. Emulated robots are made from it.
pub fn make_instance_bench(
    number: u64,
    nominal: &RobotModel,
    scenario: Scenario,
    combos: usize,
    seed: u64,
    quiet: bool,
) -> Result<Bench> {
    let Some(cameras) = RobotInstance::camera_serial(number) else {
        return make_scene_bench(nominal, scenario, combos, seed, quiet);
    };
    let own = RobotInstance::sample(nominal, number);
    let mut bench = make_scene_bench(&own.apply_to_robot(nominal), scenario, combos, seed, quiet)?;
    bench.cameras = TactileBoard::unit(&bench.world.cell.robot.hand, cameras);
    let spread = bench.world.scenario.effects.objects;
    let models: Vec<_> = bench.world.objects.iter().cloned().collect();
    for model in &models {
        // An object that has fallen stays the same instance.
        let own_name = |name: &str| name.split('/').next().map(str::to_owned);
        let place = models.iter().position(|other| own_name(&other.name) == own_name(&model.name)).unwrap_or(0);
        let mut rng = Effect::Objects.draw_rng(number, place, 0);
        let one = spread.map_or(ObjectInstance::NOMINAL, |spread| spread.draw(&mut rng));
        let real = ObjectInstance { friction: one.friction * own.pad_friction(), ..one }.apply_to(model)?;
        bench.world.objects.insert((*real).clone());
    }
    Ok(bench)
}
