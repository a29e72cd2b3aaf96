//! What each command does. `Ok(Some(text))` means: ran, but the result falls short as the text says.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use control::perception::KnownObject;
use grasping::Role;
use hand_model::Hand;
use hand_model::robot::TactileImage;
use scenarios::Sensing;
use scenarios::combination::Scenario;
use scenarios::record::TrialRecord;
use scenarios::statistics::Summary;
use sim::SimulatedRobot;
use sim::tactile::TactileBoard;
use touch::{Calibration, TouchPipeline};

use crate::bench::{self, Options};
use crate::body::Task;
use crate::body::choice::{check_body, venue};
use crate::cli::{
    ArmCommand, BenchArgs, Body, CheckArgs, Cli, Command, GraspsCommand, HandCommand, OpticsCommand, RoleArg,
    TouchCommand, TrialArgs,
};
use crate::generate::Effort;
use crate::journal::{Journal, RunRequest};
use crate::plan::{self, Plans};
use crate::recording::Recording;
use crate::touch_commands::normals::{IN_USE, Networks};
use crate::trial::ball_sizes;
use crate::trial::{Bench, NoWatcher};
use crate::world::World;
use crate::{arm_check, calibrate, check, generate, hand_close, optics_commands, study, synthesis, touch_commands};

/// The hand unit that runs the trials ...
pub const HAND_UNIT: u64 = 7;
/// ... and the one that photometric stereo was calibrated on.
pub const CALIBRATION_UNIT: u64 = 1;

/// What a command came to: nothing to say, or in which respect its result falls short.
pub type Outcome = Result<Option<String>>;

/// Runs a command.
pub fn run(cli: &Cli) -> Outcome {
    match &cli.command {
        Command::Bench(args) => benchmark(cli, args),
        Command::Trial(args) => trial(cli, args),
        Command::Replay { recording, against: None } => crate::replay::command(cli, recording),
        Command::Replay { recording, against: Some(other) } => crate::replay::against(cli, recording, other),
        Command::Transport(args) => crate::transport::run(cli, args),
        Command::View { path } => view(path),
        Command::Report { folders, study: true, .. } => match folders.as_slice() {
            [] => study::report::run(cli, Path::new("recordings/study")),
            [folder] => study::report::run(cli, folder),
            _ => bail!("--study: found {} folders, expected one", folders.len()),
        },
        Command::Report { folders, out, .. } => report(cli, folders, out.as_deref()),
        Command::Hand(HandCommand::Check(args)) => hand_check(cli, args),
        Command::Hand(HandCommand::Close(args)) => hand_close::run(cli, args),
        Command::Arm(ArmCommand::Check { out }) => {
            let rows = arm_check::run(cli.seed, out.as_deref(), cli.quiet)?;
            show_rows(cli, &rows, out.as_deref())
        }
        Command::Hand(HandCommand::Export { mjcf }) => {
            check::second_engine::export(&Arc::new(Hand::ftac()), mjcf)?;
            eprintln!(
                "{0}: scenes.json and its MJCF files; `python3 tests/mujoco/compare.py {0}` runs them",
                mjcf.display()
            );
            Ok(None)
        }
        Command::Grasps(GraspsCommand::Generate(args)) => synthesis::generate(cli, args),
        Command::Grasps(GraspsCommand::Eval { synthesis, n }) => synthesis::eval(cli, synthesis, *n),
        Command::Grasps(GraspsCommand::Repertoire(args)) => synthesis::repertoire::make(cli, args),
        Command::Grasps(GraspsCommand::Show(args)) => synthesis::show::show(cli, args),
        Command::Grasps(GraspsCommand::Hands(args)) => synthesis::hands::run(cli, args),
        Command::Grasps(GraspsCommand::Classify(args)) => study::classify::run(cli, args),
        Command::Grasps(GraspsCommand::Annotate(args)) => study::annotate::run(cli, args),
        Command::Grasps(GraspsCommand::Map(args)) => study::map::run(cli, args),
        Command::Grasps(GraspsCommand::Landscape(args)) => study::landscape::run(cli, args),
        Command::Grasps(GraspsCommand::Rehearse { object, role, n, out }) => {
            grasps_rehearse(cli, object, *role, *n, out)
        }
        Command::Grasps(GraspsCommand::Plan { combos, repertoire, out }) => {
            grasps_plan(cli, *combos, repertoire.as_deref(), out)
        }
        Command::Touch(TouchCommand::Train { presses, out }) => touch_train(cli, *presses, out),
        Command::Touch(TouchCommand::TrainNetwork(args)) => touch_commands::train_network(cli, args),
        Command::Touch(TouchCommand::Eval(args)) => touch_commands::eval(cli, args),
        Command::Optics(OpticsCommand::Calibrate(args)) => optics_commands::calibrate(cli, args),
        Command::Optics(OpticsCommand::Eval(args)) => optics_commands::eval(cli, args),
        Command::Optics(OpticsCommand::Render(args)) => optics_commands::render(cli, args),
        Command::Optics(OpticsCommand::Shapes(args)) => optics_commands::shapes(cli, args),
        Command::Optics(OpticsCommand::Pads(args)) => optics_commands::pads(cli, args),
        Command::Bridge(command) => crate::bridge::run(cli, command),
    }
}

fn repertoire() -> Result<grasping::Repertoire> {
    Ok(grasping::Repertoire::parse(include_str!("../data/repertoire.json"), Path::new("data/repertoire.json"))?)
}

/// The photometric models that come with the program.
pub fn builtin_calibration() -> Result<Calibration> {
    serde_json::from_str(include_str!("../data/calibration.json")).context("data/calibration.json")
}

/// Touch of a simulated hand with what comes with the program, given images of its untouched pads.
pub fn simulated_touch(hand: &Hand, backgrounds: Vec<Arc<TactileImage>>) -> Result<TouchPipeline> {
    Ok(Networks::builtin()?.pipeline(&look_up_touch(hand, backgrounds)?, IN_USE))
}

/// The same with slopes from the built-in calibration alone.
pub fn look_up_touch(hand: &Hand, backgrounds: Vec<Arc<TactileImage>>) -> Result<TouchPipeline> {
    let mut pipeline = TouchPipeline::new(hand, builtin_calibration()?, backgrounds)?;
    // The engine's covers are rigid, and images are made from its forces: an object shows as pressed in where it only lies on.
    pipeline.pose.sinking = 0.0;
    Ok(pipeline)
}

/// Everything that trials of a scenario's first `combos` combinations share.
pub fn make_bench(scenario: Scenario, combos: usize, seed: u64, quiet: bool) -> Result<Bench> {
    let builtin = scenario.first == Scenario::benchmark().first
        && scenario.second == Scenario::benchmark().second
        && scenario.layout == Scenario::benchmark().layout;
    let mut world = World::new(scenario)?;
    let mut repertoire = repertoire()?;
    let mut plans = Plans::parse(include_str!("../data/plans.json"), Path::new("data/plans.json"))?;
    if !builtin || combos > plans.plans.len() {
        eprintln!("this scenario's combinations are not the built-in ones: rehearsing them first");
        plans = plan::make_plans(&world, &repertoire, combos, seed, quiet)?;
    }
    plans.plans.truncate(combos);
    let board = TactileBoard::unit(&world.hand, HAND_UNIT);
    let pipeline = simulated_touch(&world.hand, board.backgrounds())?;
    let names: BTreeSet<&String> = plans.plans.iter().map(|plan| &plan.first).collect();
    let mut known = names
        .into_iter()
        .map(|name| Ok((name.clone(), KnownObject::new(world.object(name)?))))
        .collect::<Result<BTreeMap<_, _>>>()?;
    let disturbance = world.scenario.disturbance.clone();
    if let Some(sweep) = &disturbance.size_sweep {
        let balls = ball_sizes::add(sweep, &mut world, &mut repertoire)?;
        known.extend(balls.into_iter().map(|ball| (ball.name.clone(), KnownObject::new(ball))));
    }
    let mut bench =
        Bench { world, repertoire, plans, board, pipeline, known, seed, spent: Arc::default(), intact: None };
    if !disturbance.disabled().is_empty() {
        bench.do_without(disturbance.disabled())?;
    }
    Ok(bench)
}

/// The hand, and the simulated robot about to begin the ideal run of a combination of the benchmark.
pub fn trial_scene(combination: usize, seed: u64, quiet: bool) -> Result<(Arc<Hand>, SimulatedRobot)> {
    let bench = make_bench(Scenario::benchmark(), (combination + 1).min(60), seed, quiet)?;
    if combination >= bench.plans.plans.len() {
        bail!("--combo: found {combination}, expected 0 to {}", bench.plans.plans.len() - 1);
    }
    Ok((bench.world.hand.clone(), bench.scene(combination)?))
}

/// A scenario whose objects exist.
pub fn read_scenario(text: &str, path: &Path) -> Result<Scenario> {
    let scenario = Scenario::parse(text, path)?;
    scenario.check_objects(&scenarios::objects::ObjectSet::standard(), path)?;
    Ok(scenario)
}

fn next_free_folder() -> PathBuf {
    (1..).map(|n| PathBuf::from(format!("recordings/bench-{n}"))).find(|folder| !folder.exists()).unwrap_or_default()
}

fn benchmark(cli: &Cli, args: &BenchArgs) -> Outcome {
    if args.combos == 0 || args.trials == 0 {
        bail!("--combos and --trials: found {} and {}, expected at least 1 each", args.combos, args.trials);
    }
    if !(0.0..=10.0).contains(&args.noise_scale) {
        bail!("--noise-scale: found {}, expected 0 to 10", args.noise_scale);
    }
    if args.noise_scale != 1.0 && args.robot != Body::Sim {
        bail!(
            "--noise-scale: found {} with --robot {}, expected it with the simulated robot",
            args.noise_scale,
            args.robot.name()
        );
    }
    let (request, folder) = match &args.resume {
        Some(folder) => (Journal::read(folder).context("--resume")?.1, folder.clone()),
        None => {
            let path = args.scenario.clone().unwrap_or_else(|| PathBuf::from("benchmark.toml"));
            let text = match &args.scenario {
                Some(path) => {
                    std::fs::read_to_string(path).with_context(|| format!("--scenario {}", path.display()))?
                }
                None => scenarios::combination::BENCHMARK.to_owned(),
            };
            let scenario = read_scenario(&text, &path)?;
            if args.combos > scenario.combinations() {
                bail!(
                    "--combos: found {}, expected at most the scenario's {} pairs",
                    args.combos,
                    scenario.combinations()
                );
            }
            let shard = parse_shard(&args.shard)?;
            let request = RunRequest {
                combos: args.combos,
                trials: args.trials,
                seed: cli.seed,
                robot: args.robot.name().into(),
                shard,
                ablations: ablations(args)?,
                noise_scale: args.noise_scale,
                scenario: text,
            };
            (request, args.out.clone().unwrap_or_else(next_free_folder))
        }
    };
    let robot = <Body as clap::ValueEnum>::from_str(&request.robot, false)
        .map_err(|_| anyhow::anyhow!("{}: robot: found {}, expected a known body", folder.display(), request.robot))?;
    check_body(robot, args.config.as_deref())?;
    let mut scenario = read_scenario(&request.scenario, &folder.join("run.json"))?;
    scenario.noise = scenario.noise.scaled(request.noise_scale);
    if robot != Body::Sim && !scenario.disturbance.is_none() {
        bail!(
            "--robot {}: the scenario has a [disturbance], which can be done to the simulated robot (sim) only",
            robot.name()
        );
    }
    if !request.ablations.is_empty() && !scenario.disturbance.disabled().is_empty() {
        bail!("--ablations: the scenario has disabled_digits, found both, expected one of them");
    }
    let quiet = cli.quiet || cli.json;
    let jobs = if args.live || robot == Body::Hardware {
        1
    } else {
        args.jobs.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, |n| n.get()))
    };
    // Everything that can be wrong with the input has been found before anything is written.
    let mut bench = make_bench(scenario, request.combos, request.seed, quiet)?;
    bench.board = args.tactile.board(bench.board);
    let sessions = |record: bool| (record || robot == Body::Hardware).then(|| folder.join("sessions"));
    let place =
        |record: bool| venue(&bench.world, robot, args.config.as_deref(), sessions(record && robot != Body::Sim));
    // A configuration that is wrong is found before anything is written.
    drop(place(false)?);
    let journal = match &args.resume {
        Some(folder) => Journal::resume(folder)?.0,
        None => Journal::create(&folder, &request)?,
    };
    let options = Options { jobs, record: args.record, quiet, live: args.live, place: &place };
    let summary = bench::run(&bench, &request, journal, &folder, &options)?;
    tell(cli, &summary, &folder)?;
    Ok(shortfall(&summary))
}

/// What `--ablations` asks for: without names all of them.
fn ablations(args: &BenchArgs) -> Result<Vec<Sensing>> {
    let Some(names) = &args.ablations else { return Ok(Vec::new()) };
    if args.robot != Body::Sim {
        bail!("--ablations: found --robot {}, expected the simulated robot, which can go back", args.robot.name());
    }
    if names.is_empty() {
        return Ok(Sensing::ABLATIONS.to_vec());
    }
    let wanted: BTreeSet<Sensing> = names.iter().map(|name| name.parse()).collect::<Result<_, _>>()?;
    Ok(wanted.into_iter().collect())
}

fn parse_shard(text: &str) -> Result<(usize, usize)> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    match parts {
        Some((i, n)) if (1..=n).contains(&i) => Ok((i, n)),
        _ => bail!("--shard: found `{text}`, expected i/n with 1 <= i <= n, such as 1/2"),
    }
}

fn shortfall(summary: &Summary) -> Option<String> {
    let ideal = summary.conditions.ideal.collision_rate.mean.unwrap_or(0.0);
    let (blind, touch) = (summary.conditions.blind.success_rate.mean, summary.conditions.touch.success_rate.mean);
    if ideal > 0.0 {
        return Some(format!("{:.1} % of the ideal runs collided, expected none", 100.0 * ideal));
    }
    match (blind, touch) {
        (Some(blind), Some(touch)) if touch < blind => {
            Some(format!("touch succeeded less often ({touch:.3}) than blind ({blind:.3})"))
        }
        _ => None,
    }
}

fn tell(cli: &Cli, summary: &Summary, folder: &Path) -> Result<()> {
    if cli.json {
        println!("{}", serde_json::to_string(summary)?);
        return Ok(());
    }
    let number = |value: Option<f64>, digits: usize| value.map_or("-".to_owned(), |value| format!("{value:.digits$}"));
    println!("{:8} {:>7} {:>20} {:>20}", "", "trials", "collision M (SD)", "success M (SD)");
    for (name, c) in [
        ("ideal", &summary.conditions.ideal),
        ("blind", &summary.conditions.blind),
        ("touch", &summary.conditions.touch),
    ] {
        let pair = |m: &scenarios::statistics::MeanSd| format!("{} ({})", number(m.mean, 3), number(m.sd, 3));
        println!("{name:8} {:>7} {:>20} {:>20}", c.trials, pair(&c.collision_rate), pair(&c.success_rate));
    }
    for (name, t) in [
        ("collision: blind over ideal", &summary.t_test.collision),
        ("success: touch over blind", &summary.t_test.success),
    ] {
        println!("{name:28} t({}) = {}, p = {}", t.df, number(t.t, 2), t.p.map_or("-".into(), |p| format!("{p:.2e}")));
    }
    for ablation in &summary.ablations {
        println!(
            "{:34} success {} [{}, {}], {:+.3} against the whole hand",
            ablation.sensing.label(),
            number(ablation.success.value, 3),
            number(ablation.success.low, 3),
            number(ablation.success.high, 3),
            ablation.against_full.value.unwrap_or(f64::NAN)
        );
    }
    println!("decision {} ms p50, {} ms p99", number(summary.decision_ms.p50, 1), number(summary.decision_ms.p99, 1));
    println!(
        "pose error {} mm median, {} mm p95; {} deg median, {} deg p95",
        number(summary.pose_error.mm.median, 2),
        number(summary.pose_error.mm.p95, 2),
        number(summary.pose_error.deg.median, 1),
        number(summary.pose_error.deg.p95, 1)
    );
    println!(
        "wall time {:.0} s, real-time factor {}",
        summary.wall_s,
        number(Some(summary.real_time_factor.unwrap_or(f64::NAN)), 1)
    );
    println!(
        "results in {0}: report.html, summary.json, trials.csv; see a trial with `ftac view {0}`",
        folder.display()
    );
    Ok(())
}

fn trial(cli: &Cli, args: &TrialArgs) -> Outcome {
    check_body(args.robot, args.config.as_deref())?;
    let scenario = Scenario::benchmark();
    let combos = (args.combination + 1).min(60);
    let mut bench = make_bench(scenario, combos, cli.seed, cli.quiet || cli.json)?;
    bench.board = args.tactile.board(bench.board);
    if args.combination >= bench.plans.plans.len() {
        bail!("COMBO: found {}, expected 0 to {}", args.combination, bench.plans.plans.len() - 1);
    }
    let condition = args.policy.condition();
    let place = venue(&bench.world, args.robot, args.config.as_deref(), args.session.clone())?;
    let task = Task {
        robot: args.robot.name().to_owned(),
        seed: cli.seed,
        combination: args.combination,
        trial: args.trial,
        condition,
        watched: args.robot != Body::Hardware,
        combos,
        scenario: scenarios::combination::BENCHMARK.to_owned(),
    };
    if args.robot == Body::Hardware {
        let record = match place {
            Some(mut place) => bench.play(&task, place.as_mut(), &mut NoWatcher)?,
            None => bail!("--robot hardware: found no robot"),
        };
        tell_trial(cli, &record)?;
        return Ok((!record.success).then(|| format!("the trial failed: {:?}", record.cause)));
    }
    let file = args.out.clone().unwrap_or_else(|| {
        PathBuf::from(format!("recordings/combination_{}_trial_{}_{}.rrd", args.combination, args.trial, condition))
    });
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let mut targets = vec![stream::Target::File(file.clone())];
    if args.live {
        targets.push(stream::Target::Spawn);
    }
    let mut recording = Recording::open(&targets, &bench, &task)?;
    let record = match (place, condition) {
        (Some(mut place), _) => bench.play(&task, place.as_mut(), &mut recording)?,
        (None, scenarios::Condition::Ideal) => bench.ideal(args.combination, &mut recording)?,
        (None, condition) => bench.trial(args.combination, args.trial, &[condition], &[], &mut recording)?.0.remove(0),
    };
    recording.finish()?;
    tell_trial(cli, &record)?;
    if !cli.json {
        println!("recorded in {0}; see it with `ftac view {0}`", file.display());
    }
    Ok((!record.success).then(|| format!("the trial failed: {:?}", record.cause)))
}

fn tell_trial(cli: &Cli, record: &TrialRecord) -> Result<()> {
    if cli.json {
        println!("{}", serde_json::to_string(record)?);
        return Ok(());
    }
    println!(
        "{} then {}, {}: success {}, collision {}",
        record.first, record.second, record.condition, record.success, record.collision
    );
    if !record.reason.is_empty() {
        println!("{}", record.reason);
    }
    Ok(())
}

fn view(path: &Path) -> Outcome {
    // A benchmark's recordings lie in a folder of their own within its results.
    let inside = path.join("recordings");
    let opened = stream::viewer::open(if inside.is_dir() { &inside } else { path })?;
    eprintln!("opened {} recording(s)", opened.len());
    Ok(None)
}

fn report(cli: &Cli, folders: &[PathBuf], out: Option<&Path>) -> Outcome {
    let (mut journal, mut request) = Journal::read(&folders[0])?;
    for folder in &folders[1..] {
        let (other, its) = Journal::read(folder)?;
        if (its.combos, its.trials, its.seed, &its.scenario)
            != (request.combos, request.trials, request.seed, &request.scenario)
        {
            bail!(
                "{}: its combos, trials, seed or scenario differ from those of {}; only shards of one run can be merged",
                folder.display(),
                folders[0].display()
            );
        }
        journal.extend(other);
    }
    request.shard = (1, 1);
    let target = match (out, folders) {
        (Some(out), _) => out,
        (None, [only]) => only,
        _ => bail!("--out: several folders need a folder for the merged result"),
    };
    std::fs::create_dir_all(target).with_context(|| target.display().to_string())?;
    let wall: f64 = journal.values().map(|entry| entry.wall_s).sum();
    let summary = bench::finish(&journal, &request, target, wall, None)?;
    tell(cli, &summary, target)?;
    Ok(None)
}

fn hand_check(cli: &Cli, args: &CheckArgs) -> Outcome {
    let hand = Arc::new(Hand::ftac());
    if let Some(path) = &args.urdf {
        let names: Vec<String> = hand.tree.joints.iter().map(|joint| format!("{}_joint", joint.name)).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let tree = hand_model::urdf::read_tree(path, &names)?;
        eprintln!("{}: {} joints, all of the hand's joints are there", path.display(), tree.len());
        return Ok(None);
    }
    if args.engine {
        let found = check::engine::sweep(&hand)?;
        if cli.json {
            println!("{}", serde_json::json!({ "sweep": found }));
        } else {
            print!("{}", check::engine::table(&found));
        }
        return Ok(None);
    }
    if args.grasps {
        return hand_grasps(cli, args, &hand);
    }
    let options = check::Options { public_model: &args.public_model, out: args.out.as_deref(), seed: cli.seed };
    let rows = check::run(&hand, &options)?;
    show_rows(cli, &rows, args.out.as_deref())
}

/// Prints the rows of a check and keeps them in `folder`.
fn show_rows(cli: &Cli, rows: &[check::Row], folder: Option<&Path>) -> Outcome {
    let text = serde_json::json!({ "seed": cli.seed, "rows": rows });
    if let Some(folder) = folder {
        crate::report::write_whole(&folder.join("check.json"), serde_json::to_string_pretty(&text)?.as_bytes())?;
    }
    if cli.json {
        println!("{text}");
    } else {
        print!("{}", check::row::table(rows));
    }
    Ok(check::shortfall(rows))
}

fn hand_grasps(cli: &Cli, args: &CheckArgs, hand: &Arc<Hand>) -> Outcome {
    let numbers: Vec<usize> = args.types.iter().map(|number| usize::from(*number)).collect();
    let outcomes = check::feix::run(hand, cli.seed, args.tries as usize, &numbers);
    let text = serde_json::json!({ "seed": cli.seed, "tries": args.tries, "types": outcomes });
    if let Some(folder) = &args.out {
        check::feix::draw(hand, &outcomes, folder)?;
        crate::report::write_whole(&folder.join("grasps.json"), serde_json::to_string_pretty(&text)?.as_bytes())?;
    }
    if cli.json {
        println!("{text}");
    } else {
        print!("{}", check::feix::table(&outcomes));
    }
    let held = outcomes.iter().filter(|outcome| outcome.held).count();
    Ok((held < outcomes.len()).then(|| format!("{held} of {} grasp types are held", outcomes.len())))
}

fn grasps_rehearse(cli: &Cli, objects: &[String], role: Option<RoleArg>, n: u32, out: &Path) -> Outcome {
    let roles = match role {
        Some(RoleArg::First) => vec![Role::First],
        Some(RoleArg::Second) => vec![Role::Second],
        None => vec![Role::First, Role::Second],
    };
    let world = World::new(Scenario::benchmark())?;
    let names = if objects.is_empty() { world.scenario.objects() } else { objects.to_vec() };
    for name in &names {
        world.object(name)?;
    }
    let mut repertoire = if out.exists() { grasping::Repertoire::read(out)? } else { grasping::Repertoire::default() };
    repertoire.command = format!("ftac grasps rehearse --n {n} --seed {}", cli.seed);
    repertoire.seed = cli.seed;
    let effort = Effort { proposals: n, variations: n / 2, keep_first: 4, keep_second: 14 };
    generate::generate(
        &world,
        &world.rehearsal_protocol(),
        &names,
        &roles,
        effort,
        &mut repertoire,
        cli.quiet || cli.json,
    )?;
    repertoire.write(out)?;
    for name in &names {
        let count = |role| repertoire.of(name, role).count();
        eprintln!("{name:16} {:3} first grasps, {:3} second grasps", count(Role::First), count(Role::Second));
    }
    Ok(None)
}

fn grasps_plan(cli: &Cli, combos: usize, file: Option<&Path>, out: &Path) -> Outcome {
    let world = World::new(Scenario::benchmark())?;
    let repertoire = match file {
        Some(file) => grasping::Repertoire::read(file)?,
        None => repertoire()?,
    };
    let plans = plan::make_plans(&world, &repertoire, combos, cli.seed, cli.quiet || cli.json)?;
    plans.write(out)?;
    eprintln!(
        "{} combinations; {} pairs could not be done without noise and were replaced",
        plans.plans.len(),
        plans.rejected.len()
    );
    Ok(None)
}

fn touch_train(cli: &Cli, presses: usize, out: &Path) -> Outcome {
    let hand = Hand::ftac();
    let (calibration, error) = calibrate::train(&hand, CALIBRATION_UNIT, presses, cli.seed)?;
    calibration.write(out)?;
    if cli.json {
        println!(
            "{}",
            serde_json::json!({"mean_deg": error.mean, "median_deg": error.median, "p95_deg": error.p95, "pixels": error.pixels})
        );
    } else {
        println!(
            "angular error on another unit's presses: mean {:.2} deg, median {:.2} deg, p95 {:.2} deg over {} pixels",
            error.mean, error.median, error.p95, error.pixels
        );
    }
    Ok(None)
}
