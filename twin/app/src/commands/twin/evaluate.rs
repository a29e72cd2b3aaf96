//! `ftac twin evaluate`: identified robots beside the truth, over individuals whose parameters were drawn and hidden.

use anyhow::{Context as _, Result, anyhow, bail};
use clap::Args;
use hardware_bridge::driven::expect_driven;
use hardware_bridge::emulator::direct::DirectRobot;
use identification::evaluation::{Coverage, compare, coverage, median, reach};
use identification::excitation::{ExcitationError, Progress, play};
use identification::identify;
use identification::trace::Kept;
use plant::RobotIndividual;
use rayon::prelude::*;
use robot_backends::emulated::{SharedPlant, settings};
use schemars::JsonSchema;
use serde::Serialize;
use statistics::FEWEST_SAMPLES;

use super::Drawing;
use crate::options::robot::RobotArgs;
use crate::terminal::{Outcome, Terminal};

/// Goals of the evaluation: share of parameters in their intervals, the median error of a joint, rad, ...
const COVERAGE: [f64; 2] = [0.90, 0.98];
const JOINT_ERROR: f64 = 0.017_453;
/// ... and that of a fingertip on the arm, m.
const REACH_ERROR: f64 = 1e-3;

/// Arguments of `twin evaluate`.
#[derive(Debug, Args)]
pub struct EvaluateArgs {
    #[command(flatten)]
    pub model: RobotArgs,
    /// Number of the first individual.
    #[arg(long, default_value_t = 101)]
    pub from: u64,
    /// How many individuals.
    #[arg(long, default_value_t = 20)]
    pub count: u64,
}

/// Shares of parameters in their 95 % intervals.
#[derive(Debug, Serialize, JsonSchema)]
struct Shares {
    /// Of the identified ones.
    identified: f64,
    /// Of the others.
    others: f64,
}

/// Printed once all individuals are identified.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Evaluated {
    /// Seed of the devices' noise.
    seed: u64,
    /// One entry an individual.
    individuals: Vec<Row>,
    /// Over all individuals.
    coverage: Shares,
    /// Median over individuals: as drawn, identified.
    joint_rad: [f64; 2],
    /// Median over individuals: as drawn, identified.
    tip_m: [f64; 2],
    /// Median over individuals: as drawn, identified.
    reach_m: [f64; 2],
}

/// What came of one individual.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
struct Row {
    /// Its number.
    individual: u64,
    /// Parameters that the session taught something about.
    identified: Coverage,
    /// The other parameters.
    others: Coverage,
    /// Median error of a joint's angle in a free motion on which nothing was identified, rad: as drawn, and identified.
    joint: [f64; 2],
    /// Median error of a fingertip in the palm frame in that motion, m.
    tip: [f64; 2],
    /// Root mean square error of a servo's angle in it, rad.
    servo: [f64; 2],
    /// Median error of a fingertip in the frame of the arm's base, wherever the arm reaches, m: as drawn, and identified.
    reach: [f64; 2],
    /// Touches of the ball that push every link onto its stop.
    touches: usize,
    /// Distance of touches from the ball, root mean square, m: as drawn, and identified.
    ball: [f64; 2],
    /// Postures in which the weighed object was in the hand.
    held: usize,
    /// Torque of the weight left unexplained, root mean square, N m: as drawn, and identified.
    weight: [f64; 2],
    /// Why its excitation ended before its last step, and after how many, if so: it is identified from what was played.
    stopped: Option<String>,
}

pub fn run(terminal: &Terminal, args: &EvaluateArgs) -> Outcome {
    if args.count == 0 || args.from == 0 {
        bail!("--from, --count: found {}, {}, expected at least 1", args.from, args.count);
    }
    let drawing = Drawing::new(args.model.model()?)?;
    let bar = terminal.progress();
    bar.set_length(args.count);
    let rows: Result<Vec<Row>> = (args.from..args.from + args.count)
        .into_par_iter()
        .map(|number| {
            let row = evaluate(&drawing, number, terminal.seed).with_context(|| format!("individual {number}"))?;
            bar.inc(1);
            Ok(row)
        })
        .collect();
    bar.finish_and_clear();
    let rows = rows?;
    let total = |of: fn(&Row) -> Coverage| rows.iter().map(of).fold(Coverage::default(), Coverage::and);
    let (identified, others) = (total(|row| row.identified), total(|row| row.others));
    let medians =
        |of: fn(&Row) -> [f64; 2]| [0, 1].map(|n| median(&rows.iter().map(|row| of(row)[n]).collect::<Vec<_>>()));
    let (joint, tip, reach) = (medians(|row| row.joint), medians(|row| row.tip), medians(|row| row.reach));
    let mut text = format!(
        "{:>10} {:>12} {:>12} {:>18} {:>18} {:>20} {:>18} {:>24} {:>26}\n",
        "individual",
        "identified",
        "others",
        "joint, deg",
        "fingertip, mm",
        "servo rms, deg",
        "reach, mm",
        "touches of the ball, mm",
        "weight in postures, mN m"
    );
    for row in &rows {
        let pair = |values: [f64; 2], scale: f64| format!("{:.2} -> {:.2}", scale * values[0], scale * values[1]);
        text += &format!(
            "{:>10} {:>12} {:>12} {:>18} {:>18} {:>20} {:>18} {:>24} {:>26}\n",
            row.individual,
            format!("{}/{}", row.identified.inside, row.identified.of),
            format!("{}/{}", row.others.inside, row.others.of),
            pair(row.joint, 1f64.to_degrees()),
            pair(row.tip, 1e3),
            pair(row.servo, 1f64.to_degrees()),
            pair(row.reach, 1e3),
            format!("{}: {}", row.touches, pair(row.ball, 1e3)),
            format!("{}: {}", row.held, pair(row.weight, 1e3))
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
    if rows.len() < FEWEST_SAMPLES {
        let of = rows.len();
        text +=
            &format!("no verdict on the shares in their intervals: {of} of at least {FEWEST_SAMPLES} individuals\n");
    }
    let evaluated = Evaluated {
        seed: terminal.seed,
        individuals: rows,
        coverage: Shares { identified: identified.share(), others: others.share() },
        joint_rad: joint,
        tip_m: tip,
        reach_m: reach,
    };
    terminal.print(&evaluated, &text)?;
    let rows = evaluated.individuals;
    // The parameters of one robot hang together: a share over few robots shows nothing.
    let few = rows.len() < FEWEST_SAMPLES;
    let covered = few || (COVERAGE[0]..=COVERAGE[1]).contains(&identified.share());
    let stopped = |row: &Row| row.stopped.as_ref().map(|why| format!("individual {}: {why}", row.individual));
    let mut short: Vec<String> = rows.iter().filter_map(stopped).collect();
    if !covered {
        short.push(format!("{:.1} % of parameters in their intervals, expected 90 to 98", 100.0 * identified.share()));
    }
    if joint[1] > JOINT_ERROR {
        short.push(format!("joints err by {:.2} deg, expected below 1", joint[1].to_degrees()));
    }
    if reach[1] > REACH_ERROR {
        short.push(format!("fingertips err by {:.2} mm, expected below 1", 1e3 * reach[1]));
    }
    Ok((!short.is_empty()).then(|| short.join("; ")))
}

/// Joint angles of the hand whose fingertips are looked at, rad.
const BEND: f64 = 0.4;

/// Excites, identifies and compares one individual, behind all that the bridge does to commands and measurements.
fn evaluate(drawing: &Drawing, number: u64, seed: u64) -> Result<Row> {
    let Drawing { robot: nominal, losses, .. } = drawing;
    let hand = &nominal.hand;
    expect_driven(nominal)?;
    let truth = RobotIndividual::draw(nominal, number);
    let script = drawing.script(None)?;
    let plant = SharedPlant::new(drawing.plant(number, seed, &script)?);
    let settings = settings(&truth.hand(hand), seed);
    let robot = DirectRobot::start(Box::new(plant), settings, nominal).map_err(|error| anyhow!("{error}"))?;
    let mut kept = Kept::new(robot);
    let mut done = 0;
    let heard = |progress: Progress| {
        done = progress.over().map_or(done, |step| step + 1);
        if let Progress::Blocked(step, held) = progress {
            eprintln!("individual {number}, step {}: {held}", step + 1);
        }
        Ok::<(), ExcitationError>(())
    };
    let stopped = play(&mut kept, &drawing.means(&script), 0, heard, |_| true).err();
    let stopped = stopped.map(|held| format!("{held}; after {done} of {} steps", script.steps(hand).len()));
    let identification = identify(nominal, *losses, &drawing.pads, &[kept.trace(nominal, "rounded", &script)])?;
    let (found, kinematics, gains) = (identification.robot, identification.kinematics, identification.gains);
    let [identified, others] = coverage(&found, &truth);
    let designed = RobotIndividual::designed(nominal);
    let differences = compare(&truth, nominal, *losses, &nominal.arm.home, &[&designed, &found.individual]);
    let summaries: Vec<[f64; 3]> = differences.iter().map(|found| found.summary()).collect();
    let both = |n: usize| [summaries[0][n], summaries[1][n]];
    let reached = |own| median(&reach(&truth, own, nominal, &nominal.arm.home, BEND));
    Ok(Row {
        individual: number,
        identified,
        others,
        joint: both(0),
        tip: both(1),
        servo: both(2),
        reach: [reached(&designed), reached(&found.individual)],
        touches: kinematics.touches,
        ball: kinematics.residuals,
        held: gains.postures,
        weight: gains.residuals,
        stopped,
    })
}
