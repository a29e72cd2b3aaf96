//! `ftac bridge faults`: injects every fault into every phase of a trial on the emulated robot.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use bench::builtin::make_bench;
use clap::Args;
use control::executor::Phase;
use fault_injection::kind::{ALL, InjectedFault};
use fault_injection::ledger::{Ledger, MatrixRequest};
use fault_injection::table::FaultTable;
use fault_injection::{FaultMatrix, PHASES, inject_all};
use hand_model::RobotModel;
use hardware_bridge::supported_robot::check_supported;
use progress::interrupt::Interrupt;
use scenarios::Scenario;

use crate::options::robot::RobotArgs;
use crate::terminal::Terminal;

/// Version of this program: outcomes of different versions are not mixed in one matrix.
const PROGRAM_VERSION: &str = env!("CARGO_PKG_VERSION");

/// Arguments of `bridge faults`.
#[derive(Debug, Args)]
pub struct FaultArgs {
    #[command(flatten)]
    robot: RobotArgs,
    /// Folder to which each outcome is written as it comes; default: the next free recordings/faults-N.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Resume an interrupted fault matrix in its folder.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["rounds", "only", "phase", "detect_faults", "out", "seed", "robot_model"])]
    resume: Option<PathBuf>,
    /// Number of times that every fault is injected into every phase, each time in another combination.
    #[arg(long, default_value_t = 3)]
    rounds: usize,
    /// Inject only faults whose name contains this text.
    #[arg(long)]
    only: Option<String>,
    /// Inject only into phases whose name contains this text.
    #[arg(long)]
    phase: Option<String>,
    /// Number of threads; default: all cores.
    #[arg(long)]
    jobs: Option<usize>,
    /// Record every injection for the viewer into this folder, from measurements only.
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// Stream every injection to a viewer (one thread).
    #[arg(long)]
    live: bool,
    /// Run fault detection in parallel with each trial; report the detector, the delay, and the false alarms.
    #[arg(long)]
    detect_faults: bool,
}

/// Runs `ftac bridge faults`.
pub fn run(terminal: &Terminal, args: &FaultArgs) -> anyhow::Result<Option<String>> {
    let (ledger, request) = match &args.resume {
        Some(folder) => Ledger::resume(folder)?,
        None => {
            let request = request(args, terminal.seed)?;
            (Ledger::create(&args.out.clone().unwrap_or_else(next_free_folder), &request)?, request)
        }
    };
    if request.program != PROGRAM_VERSION {
        bail!(
            "--resume: {}: program: found {}, expected {PROGRAM_VERSION}: outcomes of two programs are not mixed",
            ledger.folder.display(),
            request.program
        );
    }
    let quiet = terminal.quiet || terminal.json;
    let interrupt = Interrupt::catch()?;
    let robot = RobotModel::from_sources(request.robot_model.as_ref())?;
    let bench = make_bench(&robot, Scenario::benchmark(), request.rounds.min(60), request.seed, quiet)?;
    let bar = progress::bar(0, "faults", quiet);
    if let Some(folder) = &args.record {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let jobs = if args.live { 1 } else { args.jobs.unwrap_or_else(bench::workers::available_threads).max(1) };
    let MatrixRequest { seed, rounds, kinds, phases, detector: fault_detector, .. } = request;
    let (record, live) = (args.record.clone(), args.live);
    let matrix =
        FaultMatrix { bench: &bench, kinds, phases, rounds, jobs, seed, record, live, with_detector: fault_detector };
    if !quiet {
        eprintln!("outcomes go into {} as they come", ledger.folder.display());
    }
    let outcomes = inject_all(&matrix, ledger, &bar, &|| interrupt.happened());
    bar.finish_and_clear();
    let outcomes = outcomes?;
    let table = FaultTable::new(&matrix.kinds, &outcomes);
    terminal.print(&table, &table.to_text())?;
    if !terminal.json {
        for complaint in table.wrong.iter().take(10) {
            eprintln!("{complaint}");
        }
    }
    Ok(table.shortfall())
}

/// Returns the requested fault matrix.
fn request(args: &FaultArgs, seed: u64) -> anyhow::Result<MatrixRequest> {
    let kinds: Vec<InjectedFault> =
        ALL.into_iter().filter(|kind| args.only.as_ref().is_none_or(|only| kind.name().contains(only))).collect();
    if kinds.is_empty() || args.rounds == 0 {
        let names: Vec<&str> = ALL.iter().map(|kind| kind.name()).collect();
        bail!("--only, --rounds: found no fault to inject, expected some of: {}", names.join(", "));
    }
    let wanted = |phase: &Phase| args.phase.as_ref().is_none_or(|only| phase.name().contains(only.as_str()));
    let phases: Vec<Phase> = PHASES.into_iter().filter(wanted).collect();
    if phases.is_empty() {
        let names = PHASES.map(Phase::name);
        bail!("--phase: found no phase to inject into, expected part of one of: {}", names.join(", "));
    }
    let robot = args.robot.model()?;
    check_supported(&robot)?;
    let robot_model = robot.sources;
    Ok(MatrixRequest {
        program: PROGRAM_VERSION.to_owned(),
        robot_model,
        seed,
        rounds: args.rounds,
        kinds,
        phases,
        detector: args.detect_faults,
    })
}

fn next_free_folder() -> PathBuf {
    (1..).map(|n| PathBuf::from(format!("recordings/faults-{n}"))).find(|folder| !folder.exists()).unwrap_or_default()
}
