//! `ftac sysid evaluate`: identification error over robot instances with hidden random parameters.

use anyhow::{Context as _, Result, anyhow, bail};
use clap::Args;
use hardware_bridge::emulator::direct::DirectRobot;
use hardware_bridge::supported_robot::check_supported;
use identification::evaluation::{Coverage, compare, coverage, fingertip_distances, median};
use identification::excitation::{ExcitationError, ExcitationProgress, run_script};
use identification::identify;
use identification::trace::TraceRecorder;
use plant::RobotInstance;
use rayon::prelude::*;
use robot_backends::wire_emulation::{SharedPlant, lockstep_settings};
use schemars::JsonSchema;
use serde::Serialize;
use statistics::MIN_SAMPLES;

use super::NominalModel;
use crate::options::robot::RobotArgs;
use crate::terminal::{Outcome, Terminal};

/// Goals of the evaluation: share of parameters in their 95 % intervals, and median error of a joint angle, rad.
const COVERAGE_GOAL: [f64; 2] = [0.90, 0.98];
const MAX_JOINT_ERROR: f64 = 0.017_453;
/// Goal for the median error of a fingertip in the frame of the arm's base, m.
const MAX_FINGERTIP_ERROR: f64 = 1e-3;

/// Arguments of `sysid evaluate`.
#[derive(Debug, Args)]
pub struct EvaluateArgs {
    #[command(flatten)]
    pub model: RobotArgs,
    /// Number of the first instance.
    #[arg(long, default_value_t = 101)]
    pub from: u64,
    /// Number of instances.
    #[arg(long, default_value_t = 20)]
    pub count: u64,
}

/// Coverage: shares of parameters in their 95 % intervals.
#[derive(Debug, Serialize, JsonSchema)]
struct CoverageShares {
    /// Share among identified parameters.
    identified: f64,
    /// Share among the other parameters.
    others: f64,
}

/// JSON output of `sysid evaluate`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct EvaluateOutput {
    /// Seed of the devices' noise.
    seed: u64,
    /// One entry per instance.
    instances: Vec<InstanceRow>,
    /// Coverage over all instances.
    coverage: CoverageShares,
    /// Median over instances: nominal, identified.
    joint_rad: [f64; 2],
    /// Median over instances: nominal, identified.
    tip_m: [f64; 2],
    /// Median over instances: nominal, identified.
    reach_m: [f64; 2],
}

/// Results for one instance.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
struct InstanceRow {
    /// Number of the instance.
    instance: u64,
    /// Coverage of the parameters that the session identified.
    identified: Coverage,
    /// Coverage of the other parameters.
    others: Coverage,
    /// Median error of a joint angle in a free motion not used for identification, rad: nominal, identified.
    joint: [f64; 2],
    /// Median error of a fingertip in the palm frame in that motion, m: nominal, identified.
    tip: [f64; 2],
    /// RMS error of a servo angle in that motion, rad: nominal, identified.
    servo: [f64; 2],
    /// Median error of a fingertip in the frame of the arm's base over the arm's workspace, m: nominal, identified.
    reach: [f64; 2],
    /// Number of touches of the ball that push every link onto its stop.
    touches: usize,
    /// RMS distance of the touches from the ball, m: nominal, identified.
    ball: [f64; 2],
    /// Number of postures with the payload in the hand.
    held: usize,
    /// RMS residual of the arm torques under the payload, N m: nominal, identified.
    payload: [f64; 2],
    /// Reason why the excitation ended before its last step, and the number of steps done, if so; identification then
    /// uses the completed part.
    stopped: Option<String>,
}

pub fn run(terminal: &Terminal, args: &EvaluateArgs) -> Outcome {
    if args.count == 0 || args.from == 0 {
        bail!("--from, --count: found {}, {}, expected at least 1", args.from, args.count);
    }
    let nominal = NominalModel::new(args.model.model()?)?;
    let bar = terminal.progress();
    bar.set_length(args.count);
    let rows: Result<Vec<InstanceRow>> = (args.from..args.from + args.count)
        .into_par_iter()
        .map(|number| {
            let row = evaluate(&nominal, number, terminal.seed).with_context(|| format!("instance {number}"))?;
            bar.inc(1);
            Ok(row)
        })
        .collect();
    bar.finish_and_clear();
    let rows = rows?;
    let total = |of: fn(&InstanceRow) -> Coverage| rows.iter().map(of).fold(Coverage::default(), Coverage::and);
    let (identified, others) = (total(|row| row.identified), total(|row| row.others));
    let medians = |of: fn(&InstanceRow) -> [f64; 2]| {
        [0, 1].map(|n| median(&rows.iter().map(|row| of(row)[n]).collect::<Vec<_>>()))
    };
    let (joint, tip, reach) = (medians(|row| row.joint), medians(|row| row.tip), medians(|row| row.reach));
    let mut text = format!(
        "{:>10} {:>12} {:>12} {:>18} {:>18} {:>20} {:>18} {:>24} {:>26}\n",
        "instance",
        "identified",
        "others",
        "joint, deg",
        "fingertip, mm",
        "servo rms, deg",
        "reach, mm",
        "touches of the ball, mm",
        "payload in postures, mN m"
    );
    for row in &rows {
        let pair = |values: [f64; 2], scale: f64| format!("{:.2} -> {:.2}", scale * values[0], scale * values[1]);
        text += &format!(
            "{:>10} {:>12} {:>12} {:>18} {:>18} {:>20} {:>18} {:>24} {:>26}\n",
            row.instance,
            format!("{}/{}", row.identified.inside, row.identified.of),
            format!("{}/{}", row.others.inside, row.others.of),
            pair(row.joint, 1f64.to_degrees()),
            pair(row.tip, 1e3),
            pair(row.servo, 1f64.to_degrees()),
            pair(row.reach, 1e3),
            format!("{}: {}", row.touches, pair(row.ball, 1e3)),
            format!("{}: {}", row.held, pair(row.payload, 1e3))
        );
    }
    text += &format!(
        "{:>10} {:>12} {:>12} {:>18} {:>18} {:>20} {:>18}\n",
        "all",
        format!("{:.1} %", 100.0 * identified.share()),
        format!("{:.1} %", 100.0 * others.share()),
        format!("{:.2} -> {:.2}", joint[0].to_degrees(), joint[1].to_degrees()),
        format!("{:.2} -> {:.2}", 1e3 * tip[0], 1e3 * tip[1]),
        "",
        format!("{:.2} -> {:.2}", 1e3 * reach[0], 1e3 * reach[1])
    );
    if rows.len() < MIN_SAMPLES {
        let of = rows.len();
        text += &format!("coverage is not judged: found {of} instances, expected at least {MIN_SAMPLES}\n");
    }
    let evaluated = EvaluateOutput {
        seed: terminal.seed,
        instances: rows,
        coverage: CoverageShares { identified: identified.share(), others: others.share() },
        joint_rad: joint,
        tip_m: tip,
        reach_m: reach,
    };
    terminal.print(&evaluated, &text)?;
    let rows = evaluated.instances;
    // The parameters of one robot are correlated: coverage over few robots shows nothing.
    let few = rows.len() < MIN_SAMPLES;
    let covered = few || (COVERAGE_GOAL[0]..=COVERAGE_GOAL[1]).contains(&identified.share());
    let stopped = |row: &InstanceRow| row.stopped.as_ref().map(|why| format!("instance {}: {why}", row.instance));
    let mut short: Vec<String> = rows.iter().filter_map(stopped).collect();
    if !covered {
        short.push(format!("{:.1} % of parameters in their intervals, expected 90 to 98", 100.0 * identified.share()));
    }
    if joint[1] > MAX_JOINT_ERROR {
        short.push(format!("joints err by {:.2} deg, expected below 1", joint[1].to_degrees()));
    }
    if reach[1] > MAX_FINGERTIP_ERROR {
        short.push(format!("fingertips err by {:.2} mm, expected below 1", 1e3 * reach[1]));
    }
    Ok((!short.is_empty()).then(|| short.join("; ")))
}

/// Joint angle of the hand posture for the fingertip error, rad.
const EVALUATED_JOINT_ANGLE: f64 = 0.4;

/// Excites and identifies one instance behind the bridge's full processing of commands and measurements, and compares
/// the result with the truth.
fn evaluate(drawing: &NominalModel, number: u64, seed: u64) -> Result<InstanceRow> {
    let NominalModel { robot: nominal, losses, .. } = drawing;
    let hand = &nominal.hand;
    check_supported(nominal)?;
    let truth = RobotInstance::sample(nominal, number);
    let script = drawing.script(None)?;
    let plant = SharedPlant::new(drawing.simulated_robot(number, seed, &script)?);
    let settings = lockstep_settings(&truth.apply_to_hand(hand), seed);
    let robot = DirectRobot::start(Box::new(plant), settings, nominal).map_err(|error| anyhow!("{error}"))?;
    let mut kept = TraceRecorder::new(robot);
    let mut done = 0;
    let heard = |progress: ExcitationProgress| {
        done = progress.finished_step().map_or(done, |step| step + 1);
        if let ExcitationProgress::Blocked(step, held) = progress {
            eprintln!("instance {number}, step {}: {held}", step + 1);
        }
        Ok::<(), ExcitationError>(())
    };
    let stopped = run_script(&mut kept, &drawing.excitation_inputs(&script), 0, heard, |_| true).err();
    let stopped = stopped.map(|held| format!("{held}; after {done} of {} steps", script.steps(hand).len()));
    let identification = identify(nominal, *losses, &drawing.pads, &[kept.trace(nominal, "direct", &script)])?;
    let (found, kinematics, gains) = (identification.robot, identification.kinematics, identification.gains);
    let [identified, others] = coverage(&found, &truth);
    let designed = RobotInstance::nominal(nominal);
    let differences = compare(&truth, nominal, *losses, &nominal.arm.home, &[&designed, &found.instance]);
    let summaries: Vec<[f64; 3]> = differences.iter().map(|found| found.summary()).collect();
    let both = |n: usize| [summaries[0][n], summaries[1][n]];
    let reached = |own| median(&fingertip_distances(&truth, own, nominal, &nominal.arm.home, EVALUATED_JOINT_ANGLE));
    Ok(InstanceRow {
        instance: number,
        identified,
        others,
        joint: both(0),
        tip: both(1),
        servo: both(2),
        reach: [reached(&designed), reached(&found.instance)],
        touches: kinematics.touches,
        ball: kinematics.residuals,
        held: gains.postures,
        payload: gains.residuals,
        stopped,
    })
}
