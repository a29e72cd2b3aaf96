//! `ftac touch eval`: how exact touch is, from images to poses, and how long it takes.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use scenarios::Scenario;
use scenarios::statistics::percentile;
use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::terminal::Outcome;
use crate::terminal::Terminal;
use bench::builtin::{HAND_UNIT, look_up_touch, make_bench};
use bench::networks::{IN_USE, Method, Networks};
use bench::trial::{Bench, HeldGrasp};
use lab::touch::grasps::{Played, grasps};
use lab::touch::images::{Change, Eyes};
use lab::touch::normals::{Measured, RealRow, Sampled, measure, real, unseen};
use lab::touch::pictures;
use lab::touch::poses::{Causes, Class, FAR, Felt, Source, Spread, causes, feel, spread};

/// Most of the position error of objects without symmetry that counts as good: median and 95th percentile, mm.
const GOOD: [f64; 2] = [0.5, 2.0];

/// Arguments of `touch eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Combinations whose first grasps are felt.
    #[arg(long, default_value_t = 60)]
    pub combos: usize,
    /// Trials of each combination.
    #[arg(long, default_value_t = 10)]
    pub trials: usize,
    /// Keep the simulated grasps in this file, and use them again from there.
    #[arg(long)]
    pub grasps: Option<PathBuf>,
    /// Grasps that are felt again under each change of the optics that touch was not trained on; 0 leaves them out.
    #[arg(long, default_value_t = 120)]
    pub changed: usize,
    /// Measure the networks in this folder instead of those that come with the program.
    #[arg(long)]
    pub networks: Option<PathBuf>,
    /// Presses of a 4 mm ball into a real GelSight, as `optics calibrate` reads them, 0.0295 mm a pixel; left out where they
    /// are not at hand.
    #[arg(long)]
    pub real: Option<PathBuf>,
    /// Folder for a recording and a sheet of images of the first grasp of each object.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Where the real presses lie beside a checkout.
const REAL: &str = "../shared/data/real-gelsight/taxim_gelsight";

/// Runs the command.
pub fn eval(terminal: &Terminal, args: &EvalArgs) -> Outcome {
    let quiet = terminal.quiet || terminal.json;
    let scenario = Scenario::benchmark();
    if args.combos == 0 || args.trials == 0 || args.combos > scenario.combinations() {
        bail!(
            "--combos and --trials: found {} and {}, expected 1 to {} and at least 1",
            args.combos,
            args.trials,
            scenario.combinations()
        );
    }
    let networks = args.networks.as_deref().map_or_else(Networks::builtin, Networks::read)?;
    let presses = match &args.real {
        Some(folder) => Some(folder.clone()),
        None => Some(PathBuf::from(REAL)).filter(|folder| folder.exists()),
    };
    let real = presses.as_deref().map(|folder| real(folder, &networks)).transpose()?;
    let bench = make_bench(scenario, args.combos, terminal.seed, quiet)?;
    let played = Played { combos: args.combos, trials: args.trials, seed: terminal.seed };
    let grasps = grasps(&bench, played, args.grasps.as_deref(), quiet)?;
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(grasps.len() as u64) };
    bar.set_style(ProgressStyle::with_template("{bar:28} {pos}/{len} felt [{elapsed} < {eta}]")?);
    let eyes = Eyes::new(&bench.world.cell.hand, HAND_UNIT, &Change::NONE)?;
    let felt = feel(&bench, &eyes, &bench.pipeline, &grasps, || bar.inc(1))?;
    bar.finish_and_clear();
    if let Some(folder) = &args.out {
        let objects = pictures::write(&bench, &eyes, &grasps, folder)?;
        if !quiet {
            eprintln!("{}: recordings and sheets of {objects} objects; see one with `ftac view`", folder.display());
        }
    }
    let changed = under_changes(&bench, &networks, &grasps, args.changed)?;
    let mut result = Map::new();
    result.insert("seed".into(), json!(terminal.seed));
    result.insert("grasps".into(), json!(felt.len()));
    let rows = &changed[0].normals;
    result.insert("normals".into(), normals_json(rows, real.as_deref()));
    result.insert("height_rms_um".into(), json!(of_method(rows, IN_USE).and_then(|row| row.height_rms_um)));
    result.insert("pose".into(), pose_json(&felt)?);
    let ratios: Vec<f64> = felt.iter().map(|felt| felt.ratio).collect();
    result.insert(
        "error_over_sigma".into(),
        json!({"median": percentile(&ratios, 50.0), "p95": percentile(&ratios, 95.0)}),
    );
    result.insert("latency_ms".into(), latency_json(&felt));
    result.insert("changed".into(), serde_json::to_value(&changed)?);
    if terminal.json {
        println!("{}", Value::Object(result));
    } else {
        let normals = normals_table(rows, real.as_deref());
        let poses = [pose_table(&felt), causes_table(&felt)].join("\n");
        print!("{normals}\n{poses}\n{}\n{}", changed_table(&changed), latency_table(&felt));
    }
    Ok(shortfall(&felt))
}

/// Normals and poses under a change of the optics.
#[derive(Serialize)]
struct Changed {
    change: &'static str,
    /// On the unseen shapes, by method.
    normals: Vec<(Method, Measured)>,
    /// Poses by method: that of trials alone, but for the optics as built.
    poses: Vec<(Method, Spread)>,
}

fn of_method(rows: &[(Method, Measured)], method: Method) -> Option<Measured> {
    rows.iter().find(|row| row.0 == method).map(|row| row.1)
}

/// Presses unseen shapes, and feels `count` grasps, evenly spread, as built and under every change. The untouched pads are
/// seen under it too, as a hand that is switched on sees them.
fn under_changes(bench: &Bench, networks: &Networks, grasps: &[HeldGrasp], count: usize) -> Result<Vec<Changed>> {
    let some: Vec<HeldGrasp> = match count {
        0 => Vec::new(),
        _ => grasps.iter().step_by(grasps.len().div_ceil(count).max(1)).cloned().collect(),
    };
    let changes = if count == 0 { &[][..] } else { &Change::ALL };
    std::iter::once(&Change::NONE)
        .chain(changes)
        .map(|change| {
            let hand = &bench.world.cell.hand;
            let eyes = [Eyes::new(hand, HAND_UNIT, change)?, Eyes::new(hand, HAND_UNIT + 1, change)?];
            let look_up = look_up_touch(hand, eyes[0].backgrounds())?;
            let sampled: Vec<Sampled> = unseen(&eyes, bench.seed)?;
            let normals = Method::ALL
                .map(|method| Ok((method, measure(&sampled, &eyes, &networks.pipeline(&look_up, method))?)))
                .into_iter()
                .collect::<Result<_>>()?;
            let poses = Method::ALL
                .into_iter()
                .filter(|method| !some.is_empty() && (*method == IN_USE || *change == Change::NONE))
                .map(|method| {
                    let felt = feel(bench, &eyes[0], &networks.pipeline(&look_up, method), &some, || {})?;
                    Ok((method, spread(&felt, Source::Touch, |_| true)))
                })
                .collect::<Result<_>>()?;
            Ok(Changed { change: change.name, normals, poses })
        })
        .collect()
}

fn changed_table(rows: &[Changed]) -> String {
    let mut text = format!("{:20}", "normals, mean deg");
    for method in Method::ALL {
        text += &format!(" {:>20}", method.name());
    }
    text.push('\n');
    for Changed { change, normals, .. } in rows {
        text += &format!("{change:20}");
        for (_, measured) in normals {
            text += &format!(" {:20.2}", measured.mean_deg);
        }
        text.push('\n');
    }
    text.push('\n');
    for (change, (method, Spread { grasps, mm, deg })) in
        rows.iter().flat_map(|row| row.poses.iter().map(|pose| (row.change, pose)))
    {
        let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
        text += &format!(
            "{change:20} {:20} {grasps:5} grasps {:6.2} mm median {:6.2} p95 {:6.2} deg median {:6.2} p95\n",
            method.name(),
            number(mm.median),
            number(mm.p95),
            number(deg.median),
            number(deg.p95)
        );
    }
    text
}

fn normals_json(rows: &[(Method, Measured)], real: Option<&[RealRow]>) -> Value {
    let best = real.and_then(|real| real.iter().find(|row| row.method == IN_USE && !row.simulated));
    let methods: Map<String, Value> =
        rows.iter().map(|(method, measured)| (method.name().into(), json!(measured))).collect();
    json!({
        "method": IN_USE,
        "unseen_shapes": of_method(rows, IN_USE),
        "real": best.map(|row| row.error),
        "unseen_shapes_by_method": methods,
        "real_by_method": real,
    })
}

fn normals_table(rows: &[(Method, Measured)], real: Option<&[RealRow]>) -> String {
    let mut text =
        format!("{:52} {:>9} {:>9} {:>9}   {:>9}\n", "angular error, deg", "mean", "median", "p95", "samples");
    let mut row = |name: String, measured: &Measured| {
        text += &format!(
            "{name:52} {:9.2} {:9.2} {:9.2}   {:9}",
            measured.mean_deg, measured.median_deg, measured.p95_deg, measured.samples
        );
        text += &measured.height_rms_um.map_or_else(String::new, |rms| format!("   height {rms:.1} um RMS"));
        text.push('\n');
    };
    for (method, measured) in rows {
        let used = if *method == IN_USE { " (used in trials)" } else { "" };
        row(format!("unseen shapes, {}{used}", method.name()), measured);
    }
    for RealRow { method, simulated, error } in real.unwrap_or_default() {
        let from = if *simulated { "renders of the sensor" } else { "even-numbered presses" };
        row(format!("real GelSight, {} from {from}", method.name()), error);
    }
    text
}

const SOURCES: [Source; 3] = [Source::Plan, Source::Points, Source::Touch];

fn pose_json(felt: &[Felt]) -> Result<Value> {
    let all = |pick: &dyn Fn(&Felt) -> bool| -> Result<Value> {
        let touch = serde_json::to_value(spread(felt, Source::Touch, pick))?;
        let Value::Object(mut row) = touch else { bail!("a row is an object") };
        row.insert("causes".into(), serde_json::to_value(causes(felt, pick))?);
        row.insert("plan".into(), serde_json::to_value(spread(felt, Source::Plan, pick))?);
        row.insert("points_only".into(), serde_json::to_value(spread(felt, Source::Points, pick))?);
        Ok(Value::Object(row))
    };
    let mut rows = Map::new();
    rows.insert("all".into(), all(&|_| true)?);
    for class in Class::ALL {
        rows.insert(class.name().into(), all(&|felt| felt.class == class)?);
    }
    let objects: BTreeSet<&str> = felt.iter().map(|felt| felt.object.as_str()).collect();
    let objects: Result<Map<_, _>> =
        objects.into_iter().map(|name| Ok((name.to_owned(), all(&|felt| felt.object == name)?))).collect();
    rows.insert("objects".into(), Value::Object(objects?));
    Ok(Value::Object(rows))
}

fn pose_table(felt: &[Felt]) -> String {
    let mut text = format!(
        "{:16} {:>6}   {:^27}   {:^27}   {:^27}\n{:16} {:>6}",
        "in-hand pose", "", "plan", "felt points alone", "touch", "", "grasps"
    );
    for _ in SOURCES {
        text += &format!("   {:>6} {:>6} {:>6} {:>6}", "mm", "p95", "deg", "p95");
    }
    text.push('\n');
    let mut row = |name: &str, pick: &dyn Fn(&Felt) -> bool| {
        let spreads: Vec<Spread> = SOURCES.iter().map(|source| spread(felt, *source, pick)).collect();
        text += &format!("{name:16} {:>6}", spreads[0].grasps);
        for Spread { mm, deg, .. } in spreads {
            for value in [mm.median, mm.p95, deg.median, deg.p95] {
                text += if value == mm.median { "   " } else { " " };
                text += &value.map_or_else(|| format!("{:>6}", "-"), |value| format!("{value:6.2}"));
            }
        }
        text.push('\n');
    };
    row("all", &|_| true);
    for class in Class::ALL {
        row(class.name(), &|felt| felt.class == class);
        let objects: BTreeSet<&str> =
            felt.iter().filter(|felt| felt.class == class).map(|felt| felt.object.as_str()).collect();
        for name in objects {
            row(&format!("  {name}"), &|felt| felt.object == name);
        }
    }
    text
}

/// Why poses are off, by kind of object.
fn causes_table(felt: &[Felt]) -> String {
    let mut text = format!(
        "{:16} {:>9} {:>11} {:>12} {:>12} {:>12}\n",
        "share, %",
        "in 95 %",
        format!("over {FAR} mm"),
        "misled",
        "missed",
        "untold"
    );
    let mut row = |name: &str, pick: &dyn Fn(&Felt) -> bool| {
        let Causes { covered, far, misled, missed } = causes(felt, pick);
        let [covered, far, misled, missed] = [covered, far, misled, missed].map(|share| 100.0 * share);
        let untold = far - misled - missed;
        text += &format!("{name:16} {covered:9.1} {far:11.1} {misled:12.1} {missed:12.1} {untold:12.1}\n");
    };
    row("all", &|_| true);
    for class in Class::ALL {
        row(class.name(), &|felt| felt.class == class);
    }
    text
}

/// Stages and what they take of a [`Felt`], ms.
fn stages(felt: &[Felt]) -> [(&'static str, Vec<f64>); 3] {
    let of = |pick: &dyn Fn(&Felt) -> f64| felt.iter().map(pick).collect();
    [
        ("images", of(&|felt| felt.millis[0])),
        ("pose", of(&|felt| felt.millis[1])),
        ("chain", of(&|felt| felt.millis.iter().sum())),
    ]
}

fn latency_json(felt: &[Felt]) -> Value {
    let rows = stages(felt).map(|(name, times)| {
        (name.to_owned(), json!({"p50": percentile(&times, 50.0), "p99": percentile(&times, 99.0)}))
    });
    Value::Object(rows.into_iter().collect())
}

fn latency_table(felt: &[Felt]) -> String {
    let mut text = String::new();
    for (name, times) in stages(felt) {
        let at = |percent| percentile(&times, percent).unwrap_or(f64::NAN);
        text += &format!("{name:8} {:7.2} ms p50 {:7.2} ms p99\n", at(50.0), at(99.0));
    }
    text
}

/// In which respect poses fall short.
fn shortfall(felt: &[Felt]) -> Option<String> {
    let found = spread(felt, Source::Touch, |felt| felt.class == Class::Irregular).mm;
    let (median, p95) = (found.median?, found.p95?);
    (median > GOOD[0] || p95 > GOOD[1]).then(|| {
        format!(
            "objects without symmetry are {median:.2} mm off in the median and {p95:.2} mm in the 95th percentile, aim {} and {}",
            GOOD[0], GOOD[1]
        )
    })
}
