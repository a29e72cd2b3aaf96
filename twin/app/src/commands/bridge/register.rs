//! `ftac bridge register`: registration of the arm's base on the table, by touching balls on known marks.

use std::path::PathBuf;

use anyhow::{Context as _, Result, bail};
use bench::builtin::make_scene_bench;
use clap::Args;
use ftac_platform::file_access::folder_of;
use hand_model::RobotModel;
use hardware_bridge::supported_robot::check_supported;
use nalgebra::Isometry3;
use registration::{Registrar, RegistrationFile, RegistrationPlan, RegistrationStep, hidden_mount, registration_error};
use robot_backends::hardware::HardwareFactory;
use robot_backends::operator::operator_agrees_while;
use robot_backends::wire_emulation::WireEmulationFactory;
use robot_backends::{BackendFactory as _, TrialBackend, TrialSetup, TrialStopped, TrialTask};
use scenarios::Scenario;
use scenarios::record::Condition;
use schemars::JsonSchema;
use serde::Serialize;

use super::shared::display_path;
use crate::options::robot::{RobotArgs, instance_model};
use crate::options::scenario::ScenarioArgs;
use crate::terminal::Terminal;

/// Arguments of `bridge register`.
#[derive(Debug, Args)]
pub struct RegisterArgs {
    #[command(flatten)]
    robot: RobotArgs,
    /// Configuration of the bridge.
    #[arg(long, default_value = "bridge.toml")]
    config: PathBuf,
    /// Register the emulated robot in lock-step instead, with its base at a hidden pose drawn from seed N; the result
    /// is compared with that pose.
    #[arg(long, value_name = "N", conflicts_with = "config")]
    emulated: Option<u64>,
    /// Robot instance (a file of `ftac sysid identify`) that gives the poses of pads on the hand and of the hand on the
    /// arm; an emulated robot is this instance, too.
    #[arg(long)]
    instance: Option<PathBuf>,
    /// File for the result; default: registration.toml beside the configuration, or in recordings.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Only print the planned poses of the hand, and whether the arm reaches them.
    #[arg(long)]
    dry_run: bool,
    /// Do not ask before moving.
    #[arg(long)]
    yes: bool,
}

/// Difference between two poses of the base.
#[derive(Debug, Serialize, JsonSchema)]
struct PoseDeviation {
    /// Difference of the position, taken at the centre of the marks, mm.
    mm: f64,
    /// Difference of the rotation, degrees.
    deg: f64,
}

/// JSON output of `bridge register`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct RegisterOutput {
    /// The file that was written.
    file: String,
    /// Position of the base in the world frame, m.
    position_m: [f64; 3],
    /// Rotation of the base, a quaternion i, j, k, w.
    quaternion: [f64; 4],
    /// Standard deviation of the position, taken at the centre of the marks, mm.
    sigma_mm: f64,
    /// Standard deviation of the rotation, degrees.
    sigma_deg: f64,
    /// Residual of each touch: distance of the touched point from its mark, mm.
    residuals_mm: Vec<f64>,
    /// Number of touches in the fit.
    touches: usize,
    /// Error of the result against the hidden true pose of the emulated robot; null on a real one.
    error: Option<PoseDeviation>,
    /// Error of the nominal pose of the base against the hidden true pose.
    error_before: Option<PoseDeviation>,
}

/// A planned touch.
#[derive(Debug, Serialize, JsonSchema)]
struct PlannedTouch {
    /// Number of the mark, from 1.
    mark: usize,
    /// Position of the ball's centre, m.
    x_m: f64,
    /// Position of the ball's centre, m.
    y_m: f64,
    /// Position of the ball's centre, m.
    z_m: f64,
    /// Yaw of the hand about the vertical, rad.
    heading_rad: f64,
    /// Duration of the motion there and onto the ball, s; null if the arm cannot reach it.
    seconds: Option<f64>,
}

/// JSON output of a dry run.
#[derive(Debug, Serialize, JsonSchema)]
pub struct RegisterPlanOutput {
    /// The planned touches.
    touches: Vec<PlannedTouch>,
}

pub fn run(terminal: &Terminal, args: &RegisterArgs) -> Result<Option<String>> {
    let plan = RegistrationPlan::standard()?;
    let robot = instance_model(args.instance.as_deref(), &args.robot.model()?)?;
    check_supported(&robot)?;
    let bench = make_scene_bench(&robot, Scenario::benchmark(), 1, terminal.seed, true)?;
    let registrar = Registrar::new(&bench.world, &plan, &bench.repertoire)?;
    if args.dry_run {
        return dry_run(terminal, &registrar, &plan);
    }
    let out = args.out.clone().unwrap_or_else(|| match args.emulated {
        Some(_) => PathBuf::from("recordings/registration.toml"),
        None => args.config.with_file_name("registration.toml"),
    });
    // Check that the result can be written before anything moves.
    tempfile::tempfile_in(folder_of(&out)).with_context(|| format!("{}: cannot be written", display_path(&out)))?;
    let truth = args.emulated.map(|seed| hidden_mount(&plan, seed));
    let mut body: Box<dyn TrialBackend> = match truth {
        Some(truth) => {
            let scene = registrar.simulated_robot(&truth, bench.cameras.with_noise(terminal.seed));
            let task = task(&robot, terminal.seed)?;
            let setup = TrialSetup { task: &task, objects: vec![("", Isometry3::identity())] };
            WireEmulationFactory::new(robot, None).open(&setup, scene)?
        }
        None => {
            let sessions = folder_of(&out).join("sessions");
            let mut source = HardwareFactory::new(&args.config, robot, bench.world.cell.ready_posture, sessions)?;
            if !source.has_cameras() {
                bail!(
                    "{}: found neither [cameras] nor [[uvc]], expected one of them: balls are found by touch",
                    display_path(&args.config)
                );
            }
            // Check the robot before balls are laid out.
            let mut checked = source.check()?;
            print_ball_positions(&registrar, &plan);
            let question = "The arm will move to its ready posture, then the fingers come down on each ball. Balls on their marks, hand empty, way clear?";
            if !args.yes && !operator_agrees_while(question, || checked.recheck())? {
                bail!("nothing was moved: the operator did not confirm");
            }
            Box::new(checked.arm_and_home(&[("the ball", Isometry3::identity())])?)
        }
    };
    let said = terminal.quiet || terminal.json;
    let mut tell = |step: RegistrationStep| match step {
        _ if said => {}
        RegistrationStep::Touching(mark, round) => eprint!("mark {}, touch {}: ", mark + 1, round + 1),
        RegistrationStep::NothingFelt => eprintln!("no contact"),
        RegistrationStep::Felt(off) => eprintln!(
            "contact ({:.1}, {:.1}, {:.1}) mm from its expected position",
            1e3 * off.x,
            1e3 * off.y,
            1e3 * off.z
        ),
    };
    let found = registrar.run(body.as_mut(), &bench.pipeline, &mut tell);
    if found.is_err() {
        body.hold();
    }
    let why = found.as_ref().err().map(|error| format!("{error:#}"));
    let left = body.end_trial(why.as_deref());
    drop(body);
    let (registration, points) = match found {
        Ok(found) => found,
        Err(error) if error.downcast_ref::<TrialStopped>().is_some() => {
            return Ok(Some(format!("not registered: {error:#}")));
        }
        Err(error) => return Err(error.context("not registered; no file was written")),
    };
    left?;
    let file = RegistrationFile::new(&registration);
    ftac_platform::data::write_atomically(&out, file.to_toml()?.as_bytes())?;
    let error = truth.map(|truth| registration_error(&registration.world_from_base, &truth, &registration.centroid));
    let before = truth.map(|truth| self::registration_error(&Isometry3::identity(), &truth, &registration.centroid));
    let mm = |metres: f64| 1e3 * metres;
    let sigma = |from: usize| file.sigma[from..from + 3].iter().map(|sigma| sigma * sigma).sum::<f64>().sqrt();
    if terminal.json {
        let deviation = |(place, turn): (f64, f64)| PoseDeviation { mm: mm(place), deg: turn.to_degrees() };
        let registered = RegisterOutput {
            file: display_path(&out),
            position_m: file.position,
            quaternion: file.quaternion,
            sigma_mm: mm(sigma(0)),
            sigma_deg: sigma(3).to_degrees(),
            residuals_mm: file.residuals.iter().map(|residual| mm(*residual)).collect(),
            touches: points.len(),
            error: error.map(deviation),
            error_before: before.map(deviation),
        };
        terminal.print(&registered, "")?;
        return Ok(None);
    }
    let worst = file.residuals.iter().copied().fold(0.0, f64::max);
    println!("{} touches; the largest residual is {:.1} mm", points.len(), mm(worst));
    let turn = registration.world_from_base.rotation.scaled_axis().map(f64::to_degrees);
    let place = file.position.map(mm);
    println!(
        "the base stands at ({:.1}, {:.1}, {:.1}) mm, turned by ({:.2}, {:.2}, {:.2}) deg; standard deviation {:.1} mm and {:.2} deg",
        place[0],
        place[1],
        place[2],
        turn.x,
        turn.y,
        turn.z,
        mm(sigma(0)),
        sigma(3).to_degrees()
    );
    if let (Some((place, turn)), Some((was, turned))) = (error, before) {
        println!(
            "error against the hidden pose: {:.2} mm and {:.2} deg; before: {:.2} mm and {:.2} deg",
            mm(place),
            turn.to_degrees(),
            mm(was),
            turned.to_degrees()
        );
    }
    println!("{}: give it to trial and bench with --registration", display_path(&out));
    Ok(None)
}

/// Returns the task of an emulated robot that runs no trial.
fn task(robot: &RobotModel, seed: u64) -> Result<TrialTask> {
    let (_, text) = ScenarioArgs::default().read()?;
    Ok(TrialTask {
        scenario: text,
        robot_model: robot.sources.clone(),
        ..TrialTask::new("emulated", seed, [0, 0, 1], Condition::Touch)
    })
}

/// Prints the places of the balls.
fn print_ball_positions(registrar: &Registrar, plan: &RegistrationPlan) {
    for mark in 0..plan.marks.len() {
        let middle = registrar.ball_center(mark);
        eprintln!("mark {}: a {} at x {:.3}, y {:.3} m", mark + 1, plan.object, middle.x, middle.y);
    }
}

fn dry_run(terminal: &Terminal, registrar: &Registrar, plan: &RegistrationPlan) -> Result<Option<String>> {
    let times = registrar.dry_run()?;
    let rows = || {
        times.iter().enumerate().flat_map(|(mark, times)| {
            times.iter().zip(&plan.headings).map(move |(time, heading)| (mark, *heading, *time))
        })
    };
    if terminal.json {
        let touch = |(mark, heading_rad, seconds)| {
            let middle = registrar.ball_center(mark);
            PlannedTouch { mark: mark + 1, x_m: middle.x, y_m: middle.y, z_m: middle.z, heading_rad, seconds }
        };
        terminal.print(&RegisterPlanOutput { touches: rows().map(touch).collect() }, "")?;
    } else {
        println!("{:4} {:>8} {:>8} {:>8} {:>12}  approach and touch", "mark", "x, m", "y, m", "z, m", "turned, deg");
        for (mark, heading, time) in rows() {
            let middle = registrar.ball_center(mark);
            let time = time.map_or("out of reach".to_owned(), |time| format!("{time:.1} s"));
            println!(
                "{:<4} {:>8.3} {:>8.3} {:>8.3} {:>12.0}  {time}",
                mark + 1,
                middle.x,
                middle.y,
                middle.z,
                heading.to_degrees()
            );
        }
    }
    let missed = rows().find(|(_, _, time)| time.is_none());
    Ok(missed.map(|(mark, heading, _)| {
        format!("the arm does not reach mark {} turned by {:.0} deg", mark + 1, heading.to_degrees())
    }))
}
