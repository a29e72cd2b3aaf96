//! The fault matrix as a table.

use anyhow::bail;
use bench::builtin::make_bench;
use bench::faults::kind::ALL;
use clap::Args;
use control::executive::Phase;
use scenarios::Scenario;
use std::collections::BTreeSet;

use serde_json::{Value, json};

use crate::terminal::Terminal;
use bench::faults::kind::{Expected, Kind};
use bench::faults::{Matrix, Outcome, PHASES, inject_all};

/// What came of one kind of fault.
fn row(kind: Kind, of: &[&Outcome]) -> Value {
    let sorted = |value: fn(&Outcome) -> Option<f64>| {
        let mut times: Vec<f64> = of.iter().filter_map(|outcome| value(outcome)).collect();
        times.sort_by(f64::total_cmp);
        times
    };
    let (stops, times) = (sorted(|outcome| outcome.stopped_ms), sorted(|outcome| outcome.safe_ms));
    let time = |outcome: &Outcome| outcome.safe_ms.unwrap_or(0.0);
    let safe = of.iter().filter(|outcome| outcome.safe_ms.is_some());
    let slowest = safe.max_by(|a, b| time(a).total_cmp(&time(b)));
    let sum = |value: fn(&Outcome) -> usize| of.iter().map(|outcome| value(outcome)).sum::<usize>();
    json!({
        "fault": kind.name(),
        "expected": match kind.expected() {
            Expected::GoesOn => "goes on",
            Expected::Holds => "hold",
            Expected::Faults => "fault",
            Expected::StopsItself => "stops itself",
        },
        "injected": of.len(),
        "as_expected": sum(|outcome| usize::from(outcome.as_expected)),
        "stopped": times.len(),
        "stopped_ms_median": stops.get(stops.len() / 2),
        "stopped_ms_max": stops.last(),
        "slowest_in": slowest.map(|outcome| outcome.phase.name()),
        "slowest_began_at_rad_s": slowest.map(|outcome| outcome.speed),
        "safe_ms_median": times.get(times.len() / 2),
        "safe_ms_max": times.last(),
        "outside_limits": of.iter().map(|outcome| outcome.outside).sum::<u64>(),
        "held": sum(|outcome| outcome.held),
        "lost": sum(|outcome| outcome.lost),
        "moved_mm_max": of.iter().map(|outcome| outcome.moved).fold(0.0, f64::max),
        "takes_torque": kind.takes_torque(),
        "recordings_intact": sum(|outcome| usize::from(outcome.intact)),
    })
}

fn print_rows(rows: &[Value]) {
    println!(
        "{:34} {:>12} {:>8} {:>8} {:>18} {:>18} {:>8} {:>12} {:>9} {:>7}",
        "fault",
        "expected",
        "injected",
        "so",
        "ms to hold (max)",
        "arm stands (max)",
        "outside",
        "lost of held",
        "moved mm",
        "intact"
    );
    for row in rows {
        let ms = |name: &str| row[name].as_f64().map_or("-".to_owned(), |ms| format!("{ms:.0}"));
        let mark = if row["takes_torque"] == true { "*" } else { "" };
        let number = |name: &str| row[name].to_string();
        println!(
            "{:34} {:>12} {:>8} {:>8} {:>18} {:>18} {:>8} {:>12} {:>9.1} {:>7}",
            row["fault"].as_str().unwrap_or_default(),
            row["expected"].as_str().unwrap_or_default(),
            number("injected"),
            number("as_expected"),
            format!("{} ({})", ms("stopped_ms_median"), ms("stopped_ms_max")),
            format!("{} ({})", ms("safe_ms_median"), ms("safe_ms_max")),
            number("outside_limits"),
            format!("{} of {}{mark}", row["lost"], row["held"]),
            row["moved_mm_max"].as_f64().unwrap_or_default(),
            number("recordings_intact"),
        );
    }
    println!("* the fault itself takes a servo's torque: what that digit held may fall, whatever the others hold");
}

/// Prints the results; the shortfall is the first unexpected one.
fn tell(terminal: &Terminal, kinds: &[Kind], outcomes: &[Outcome]) -> Option<String> {
    let of = |kind: &Kind| outcomes.iter().filter(|outcome| outcome.kind == *kind).collect::<Vec<_>>();
    let rows: Vec<Value> = kinds.iter().map(|kind| row(*kind, &of(kind))).collect();
    let wrong: Vec<String> = outcomes.iter().filter_map(complaint).collect();
    let phases = outcomes.iter().map(|outcome| outcome.phase).collect::<BTreeSet<_>>().len();
    let (injected, checked) = (outcomes.len(), outcomes.iter().map(|outcome| outcome.checked).sum::<u64>());
    if terminal.json {
        let result =
            json!({ "injected": injected, "phases": phases, "goals_checked": checked, "rows": rows, "wrong": wrong });
        println!("{result}");
    } else {
        print_rows(&rows);
        println!(
            "{injected} faults in {phases} phases, {checked} goals of servos and joints checked against their limits; times on the \
             emulated clock until the supervisor holds (or servos and arm have stopped by themselves), and until the arm stands"
        );
        for complaint in wrong.iter().take(10) {
            eprintln!("{complaint}");
        }
    }
    let more = if wrong.len() > 1 { format!(" (and {} more)", wrong.len() - 1) } else { String::new() };
    wrong.first().map(|first| format!("{first}{more}"))
}

/// What should not have come of a fault.
fn complaint(outcome: &Outcome) -> Option<String> {
    let Outcome { kind, phase, round, state, .. } = outcome;
    let what = if !outcome.as_expected {
        format!("ended in `{state}`")
    } else if outcome.outside > 0 {
        format!("{} commands outside their limits", outcome.outside)
    } else if outcome.lost > 0 && !kind.takes_torque() && kind.expected() != Expected::GoesOn {
        format!("{} of {} held objects lost in `{state}`", outcome.lost, outcome.held)
    } else if !outcome.intact {
        "the recording is not intact".to_owned()
    } else {
        return None;
    };
    Some(format!("{} in {}, round {round}: {what}", kind.name(), phase.name()))
}

/// Arguments of `bridge faults`.
#[derive(Debug, Args)]
pub struct FaultArgs {
    /// Times every fault is injected into every phase, each time in another combination.
    #[arg(long, default_value_t = 3)]
    rounds: usize,
    /// Only faults whose name contains this.
    #[arg(long)]
    only: Option<String>,
    /// Only phases whose name contains this.
    #[arg(long)]
    phase: Option<String>,
    /// Threads; default: all cores.
    #[arg(long)]
    jobs: Option<usize>,
}

/// `ftac bridge faults`.
pub fn run(terminal: &Terminal, args: &FaultArgs) -> anyhow::Result<Option<String>> {
    let kinds: Vec<Kind> =
        ALL.into_iter().filter(|kind| args.only.as_ref().is_none_or(|only| kind.name().contains(only))).collect();
    if kinds.is_empty() || args.rounds == 0 {
        let names: Vec<&str> = ALL.iter().map(|kind| kind.name()).collect();
        bail!("--only, --rounds: found no fault to inject, expected some of: {}", names.join(", "));
    }
    let wanted = |phase: &Phase| args.phase.as_ref().is_none_or(|only| phase.name().contains(only));
    let phases: Vec<Phase> = PHASES.into_iter().filter(wanted).collect();
    if phases.is_empty() {
        let names = PHASES.map(Phase::name);
        bail!("--phase: found no phase to inject into, expected part of one of: {}", names.join(", "));
    }
    let quiet = terminal.quiet || terminal.json;
    let bench = make_bench(Scenario::benchmark(), args.rounds.min(60), terminal.seed, quiet)?;
    let bar = if quiet { indicatif::ProgressBar::hidden() } else { indicatif::ProgressBar::new(0) };
    let jobs = args.jobs.unwrap_or_else(|| bench::workers::available()).max(1);
    let matrix = Matrix { bench: &bench, kinds, phases, rounds: args.rounds, jobs, seed: terminal.seed };
    let outcomes = inject_all(&matrix, &bar)?;
    bar.finish_and_clear();
    Ok(tell(terminal, &matrix.kinds, &outcomes))
}
