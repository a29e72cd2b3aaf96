//! `ftac bench` and `ftac report`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use bench::builtin::{COMBINATIONS, hide_plant, make_identified, read_pads_by};
use bench::journal::{Journal, RunRequest};
use bench::own::{Own, Pace, Source};
use bench::run::{self, Options, Record as Recorded};
use clap::{Args, ValueEnum};
use control::policy::Uncertainty;
use scenarios::Ablation;
use scenarios::effects::Effect;
use scenarios::record::Condition;
use scenarios::statistics::Summary;

use super::body::{Body, PlaceArgs, check_body, source};
use super::scenario::ScenarioArgs;
use super::tactile_backend::TactileBackend;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Object combinations; default: 60, or all pairs of a scenario that has fewer.
    #[arg(long)]
    pub combos: Option<usize>,
    /// Trials of each combination.
    #[arg(long, default_value_t = 10)]
    pub trials: usize,
    /// Conditions that are played.
    #[arg(long, value_delimiter = ',', default_value = "ideal,blind,reflex,touch", value_name = "CONDITIONS")]
    pub conditions: Vec<String>,
    /// Policy of your own, which plays as the condition `own` beside the others: a Python class, as FILE.py:CLASS. See twin/python/README.md.
    #[arg(long, value_name = "FILE:CLASS")]
    pub policy: Option<String>,
    /// What the class of your own policy is made with, once for each of its arguments. A value that is JSON is that (0.5, true, [1, 2]), any other is text.
    #[arg(long, value_name = "KEY=VALUE", requires = "policy")]
    pub policy_arg: Vec<String>,
    /// How long your own policy may take for an answer, s; default: 60. One that takes longer fails its trial, and its process is ended.
    #[arg(long, value_name = "SECONDS", requires = "policy", value_parser = clap::value_parser!(u32).range(1..=86_400))]
    pub policy_timeout: Option<u32>,
    /// What passes while your own policy thinks: nothing (`stand`), or as much simulated time as on the wall.
    #[arg(long, value_enum, default_value_t = PolicyTime::Stand, requires = "policy")]
    pub policy_time: PolicyTime,
    /// Body.
    #[arg(long, value_enum, default_value_t = Body::Sim)]
    pub robot: Body,
    /// Configuration of the hardware bridge, for --robot hardware.
    #[arg(long)]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub places: PlaceArgs,
    #[command(flatten)]
    pub scenario: ScenarioArgs,
    /// Threads; default: all cores.
    #[arg(long)]
    pub jobs: Option<usize>,
    /// Run only shard i of n, as `i/n`.
    #[arg(long, default_value = "1/1")]
    pub shard: String,
    /// Result folder; default: the next free recordings/bench-N.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Which trials are recorded.
    #[arg(long, value_enum, default_value_t = Record::Sample)]
    pub record: Record,
    /// Factor of all of the scenario's noise, for a curve of rates over noise.
    #[arg(long, default_value_t = 1.0)]
    pub noise_scale: f64,
    /// Switch off effects of the scenario: pads, gel, cables, eyes, arm, objects, floor, time, or all.
    #[arg(long, value_delimiter = ',', value_name = "EFFECTS")]
    pub without: Vec<String>,
    /// What the controller expects to go wrong: a file like twin/control/data/uncertainty.toml, which is the default.
    #[arg(long, value_name = "FILE")]
    pub uncertainty: Option<PathBuf>,
    /// The robot that body and control stack are: a file of `ftac twin identify`; default: the robot as drawn.
    #[arg(long, value_name = "FILE")]
    pub individual: Option<PathBuf>,
    /// Calibration of the pads by which touch reads images: a file of `ftac touch train`, or of the hand's own pads; default: the designed
    /// pads'.
    #[arg(long, value_name = "FILE")]
    pub pads: Option<PathBuf>,
    /// Touch and reflex play second grasps in a twin of the scene before they choose one, from the state as felt.
    #[arg(long)]
    pub foresee: bool,
    /// Let a twin run beside the robot and name what differs, in divergences.csv.
    #[arg(long)]
    pub mirror: bool,
    /// Which of the robots built from the drawing a simulated or emulated body is, unknown to the control stack; default: what the control
    /// stack takes it for.
    #[arg(long, value_name = "N")]
    pub plant: Option<u64>,
    /// Also run touch without one of its means, all of them or those named: palm_only, fingertips, quarter_of_pads,
    /// coarse_images, points_only, true_pose, no_retry, no_new_look, no_exploration.
    #[arg(long, num_args = 0.., value_delimiter = ',', value_name = "NAMES")]
    pub ablations: Option<Vec<String>>,
    /// Stream every trial to a Rerun viewer as well (one thread).
    #[arg(long)]
    pub live: bool,
    /// Where tactile images are rendered.
    #[arg(long, value_enum, default_value_t = TactileBackend::Cpu)]
    pub tactile: TactileBackend,
    /// Go on with the interrupted run in this folder.
    #[arg(
        long,
        conflicts_with_all = [
            "combos", "trials", "seed", "conditions", "robot", "scenario", "shard", "out", "noise_scale", "without",
            "uncertainty", "ablations", "policy_arg", "policy_timeout", "policy_time", "registration", "mount", "individual", "plant",
            "foresee", "mirror", "pads",
        ]
    )]
    pub resume: Option<PathBuf>,
}

/// What passes while a policy of the user's own thinks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PolicyTime {
    /// No simulated time.
    Stand,
    /// As much as on the wall. On the real robot it always does.
    Wall,
}

/// Which trials are recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Record {
    /// None.
    None,
    /// The first trial of every tenth combination.
    Sample,
    /// Of each condition the first trial for each cause of failure, played again after the run.
    Causes,
    /// Every trial.
    All,
}

impl From<Record> for Recorded {
    fn from(record: Record) -> Self {
        match record {
            Record::None => Self::None,
            Record::Sample => Self::Sample,
            Record::Causes => Self::Causes,
            Record::All => Self::All,
        }
    }
}

/// The run that is asked for, or the interrupted one that goes on, and its folder.
fn request(terminal: &Terminal, args: &BenchArgs) -> Result<(RunRequest, PathBuf)> {
    if args.combos == Some(0) {
        bail!("--combos: found 0, expected at least 1");
    }
    if args.trials == 0 {
        bail!("--trials: found 0, expected at least 1");
    }
    if args.jobs == Some(0) {
        bail!("--jobs: found 0, expected at least 1");
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
    if let Some(folder) = &args.resume {
        let request = Journal::read(folder).context("--resume")?.1;
        check_policy(request.policy.as_ref(), args.policy.as_deref(), folder)?;
        return Ok((request, folder.clone()));
    }
    let (scenario, text) = args.scenario.read()?;
    let pairs = scenario.combinations();
    let combos = args.combos.unwrap_or(pairs.min(COMBINATIONS));
    if combos > pairs {
        bail!("--combos: found {combos}, expected at most the scenario's {pairs} pairs");
    }
    let request = RunRequest {
        combos,
        trials: args.trials,
        seed: terminal.seed,
        robot: args.robot.name().into(),
        shard: parse_shard(&args.shard)?,
        conditions: conditions(&args.conditions, args.policy.is_some())?,
        ablations: ablations(args)?,
        without: without(&args.without)?,
        uncertainty: uncertainty(args.uncertainty.as_deref())?,
        policy: policy(args)?,
        noise_scale: args.noise_scale,
        scenario: text,
        places: args.places.places(args.robot)?,
        individual: super::individual::text(args.individual.as_deref())?.0,
        pads: super::individual::pads(args.pads.as_deref())?,
        plant: args.plant,
        foresees: args.foresee,
        mirrors: args.mirror,
        // Known once the scenario's own objects have been tried.
        notes: Vec::new(),
        left_out: Vec::new(),
    };
    Ok((request, args.out.clone().unwrap_or_else(next_free_folder)))
}

/// `ftac bench`: everything that can be wrong with the input is found before anything is written.
pub fn benchmark(terminal: &Terminal, args: &BenchArgs) -> Outcome {
    let (mut request, folder) = request(terminal, args)?;
    let robot = <Body as clap::ValueEnum>::from_str(&request.robot, false)
        .map_err(|_| anyhow::anyhow!("{}: robot: found {}, expected a known body", folder.display(), request.robot))?;
    if request.places.eyes != args.places.eyes.is_some() {
        let (found, expected) = if request.places.eyes { ("none", "them") } else { ("them", "none") };
        bail!("--eyes: found {found}, expected {expected}, as the run in {} was begun", folder.display());
    }
    check_body(robot, args.config.as_deref(), &request.conditions)?;
    let scenario = request.scenario().with_context(|| folder.display().to_string())?;
    if robot != Body::Sim && !scenario.disturbance.is_none() {
        bail!(
            "--robot {}: the scenario has a [disturbance], which can be done to the simulated robot (sim) only",
            robot.name()
        );
    }
    if !request.ablations.is_empty() && !scenario.disturbance.disabled().is_empty() {
        bail!("--ablations: the scenario has disabled_digits, found both, expected one of them");
    }
    if robot == Body::Hardware && request.plant.is_some() {
        bail!("--plant: --robot is hardware, which is the individual that it is");
    }
    let quiet = terminal.quiet || terminal.json;
    let jobs =
        if args.live || robot == Body::Hardware { 1 } else { args.jobs.unwrap_or_else(bench::workers::available) };
    // Everything that can be wrong with the input has been found before anything is written.
    let (individual, named) = (request.individual.as_deref(), Path::new("--individual"));
    let mut bench = make_identified(individual, named, scenario, request.combos, request.seed, quiet)?;
    let asked = request.combos;
    if args.resume.is_none() {
        request.combos = bench.plans.plans.len().min(asked);
        (request.notes, request.left_out) = (bench.notes.clone(), bench.left_out.clone());
    }
    request.places.set_up(&mut bench.world)?;
    read_pads_by(&mut bench, request.pads.as_deref(), Path::new("--pads"))?;
    super::individual::say_whose_pads(robot, &request.conditions, request.pads.as_deref());
    if let Some(number) = request.plant {
        hide_plant(&mut bench, number);
    }
    bench.board = args.tactile.board(bench.board);
    bench.foresee(request.foresees);
    // What stopped a robot that is none is gone with the trial; a real one waits for an operator.
    bench.outlasts_faults = robot != Body::Hardware && request.policy.is_none();
    if let Some(text) = &request.uncertainty {
        bench.uncertainty = Uncertainty::parse(text, Path::new("--uncertainty"))?;
    }
    if let Some(source) = &request.policy {
        source.check()?;
        bench.own = Some(Own::start(source.clone())?);
    }
    let sessions = |record: bool| (record || robot == Body::Hardware).then(|| folder.join("sessions"));
    let place = |record: bool| {
        source(&bench.world, robot, (args.config.as_deref(), &args.places), sessions(record && robot != Body::Sim))
    };
    // A configuration that is wrong is found before anything is written.
    drop(place(false)?);
    let journal = match &args.resume {
        Some(folder) => Journal::resume(folder)?.0,
        None => Journal::create(&folder, &request)?,
    };
    let options = Options { jobs, record: args.record.into(), quiet, live: args.live, place: &place };
    let summary = run::run(&bench, &request, journal, &folder, &options)?;
    tell(terminal, &summary, &folder)?;
    let fewer = (args.combos.is_some() && request.combos < asked)
        .then(|| format!("only {} of {asked} combinations can be done", request.combos));
    Ok(shortfall(&summary).or(fewer))
}

/// What `--ablations` asks for: without names all of them.
fn ablations(args: &BenchArgs) -> Result<Vec<Ablation>> {
    let Some(names) = &args.ablations else { return Ok(Vec::new()) };
    if args.robot != Body::Sim {
        bail!("--ablations: found --robot {}, expected the simulated robot, which can go back", args.robot.name());
    }
    if names.is_empty() {
        return Ok(Ablation::ALL.to_vec());
    }
    let wanted: BTreeSet<Ablation> = names.iter().map(|name| name.parse()).collect::<Result<_, _>>()?;
    Ok(wanted.into_iter().collect())
}

/// What `--conditions` asks for, in the order of `trials.csv`; with a policy of the user's `own`, that too.
fn conditions(names: &[String], own: bool) -> Result<Vec<Condition>> {
    let mut wanted: BTreeSet<Condition> =
        names.iter().map(|name| name.parse()).collect::<Result<_, _>>().context("--conditions")?;
    if wanted.contains(&Condition::Own) && !own {
        bail!("--conditions: found own, expected --policy FILE.py:CLASS with it");
    }
    wanted.extend(own.then_some(Condition::Own));
    Ok(wanted.into_iter().collect())
}

/// The policy that `--policy` names.
fn policy(args: &BenchArgs) -> Result<Option<Source>> {
    // On the real robot time passes by itself.
    let waits = args.policy_time == PolicyTime::Wall && args.robot != Body::Hardware;
    let pace = if waits { Pace::Wall } else { Pace::Stand };
    let Some(text) = &args.policy else { return Ok(None) };
    let source = Source::parse(text, &args.policy_arg, pace)?;
    Ok(Some(Source { timeout: args.policy_timeout.unwrap_or(source.timeout), ..source }))
}

/// A folder may be another's: which program runs is not for its files to say, but for the command line.
fn check_policy(kept: Option<&Source>, named: Option<&str>, folder: &Path) -> Result<()> {
    let of = |source: &Source| format!("{}:{}", source.file.display(), source.class);
    match (kept, named) {
        (None, None) => Ok(()),
        (Some(kept), Some(named)) if of(kept) == named => Ok(()),
        (None, Some(named)) => {
            bail!("--policy: found {named}, expected none, as the run in {} was begun", folder.display())
        }
        (Some(kept), found) => bail!(
            "--resume {}: found {}, expected --policy {}, which the run was begun with: a folder does not choose what runs",
            folder.display(),
            found.map_or("no --policy".to_owned(), |found| format!("--policy {found}")),
            of(kept)
        ),
    }
}

/// What `--without` asks for.
fn without(names: &[String]) -> Result<Vec<Effect>> {
    if names.iter().any(|name| name == "all") {
        return Ok(Effect::ALL.to_vec());
    }
    let wanted: BTreeSet<Effect> =
        names.iter().map(|name| name.parse()).collect::<Result<_, _>>().context("--without (or all)")?;
    Ok(wanted.into_iter().collect())
}

/// The text of the file that `--uncertainty` names, once it is known to be good.
fn uncertainty(path: Option<&Path>) -> Result<Option<String>> {
    let Some(path) = path else { return Ok(None) };
    let text = hand_model::data::read_text(path).context("--uncertainty")?;
    Uncertainty::parse(&text, path).context("--uncertainty")?;
    Ok(Some(text))
}

fn next_free_folder() -> PathBuf {
    (1..).map(|n| PathBuf::from(format!("recordings/bench-{n}"))).find(|folder| !folder.exists()).unwrap_or_default()
}

fn parse_shard(text: &str) -> Result<(usize, usize)> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    match parts {
        Some((i, n)) if (1..=n).contains(&i) => Ok((i, n)),
        _ => bail!("--shard: found `{text}`, expected i/n with 1 <= i <= n, such as 1/2"),
    }
}

fn shortfall(summary: &Summary) -> Option<String> {
    if !summary.left_out.is_empty() {
        return Some(summary.left_out.join("; "));
    }
    let ideal = summary.conditions.ideal.contact_rate.mean.unwrap_or(0.0);
    let clean = |condition: Condition| summary.conditions.of(condition).clean_success_rate.mean;
    if ideal > 0.0 {
        return Some(format!("{:.1} % of the ideal runs had an unwanted contact, expected none", 100.0 * ideal));
    }
    [Condition::Blind, Condition::Reflex].into_iter().find_map(|rival| match (clean(rival), clean(Condition::Touch)) {
        (Some(rate), Some(touch)) if touch < rate => {
            Some(format!("touch succeeded cleanly less often ({touch:.3}) than {rival} ({rate:.3})"))
        }
        _ => None,
    })
}

/// `ftac report`: a run once more, or the shards of one put together.
pub fn report(terminal: &Terminal, folders: &[PathBuf], out: Option<&Path>) -> Outcome {
    let (mut journal, mut request) = Journal::read(&folders[0])?;
    for folder in &folders[1..] {
        let (other, its) = Journal::read(folder)?;
        let asked = |of: &RunRequest| (of.combos, of.trials, of.seed, of.conditions.clone(), of.scenario.clone());
        if asked(&its) != asked(&request) || its.policy != request.policy {
            bail!(
                "{}: its combos, trials, seed, conditions, policy or scenario differ from those of {}; only shards of one run can be merged",
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
    let summary = run::finish(&journal, &request, target, wall, None)?;
    tell(terminal, &summary, target)?;
    Ok(None)
}

/// Whether there is a recording to look at.
fn recorded(folder: &Path) -> bool {
    std::fs::read_dir(folder.join("recordings")).is_ok_and(|mut recordings| recordings.next().is_some())
}

fn tell(terminal: &Terminal, summary: &Summary, folder: &Path) -> Result<()> {
    if terminal.json {
        println!("{}", serde_json::to_string(summary)?);
        return Ok(());
    }
    let number = |value: Option<f64>, digits: usize| value.map_or("-".to_owned(), |value| format!("{value:.digits$}"));
    println!(
        "{:8} {:>6} {:>17} {:>17} {:>17} {:>9}",
        "", "trials", "contact M (SD)", "success M (SD)", "clean M (SD)", "time (s)"
    );
    for condition in summary.conditions.listed() {
        let c = summary.conditions.of(condition);
        let pair = |m: &scenarios::statistics::MeanSd| format!("{} ({})", number(m.mean, 3), number(m.sd, 3));
        println!(
            "{:8} {:>6} {:>17} {:>17} {:>17} {:>9}",
            condition.name(),
            c.trials,
            pair(&c.contact_rate),
            pair(&c.success_rate),
            pair(&c.clean_success_rate),
            number(c.trial_s.mean, 1)
        );
    }
    for (name, t) in [
        ("contact: blind over ideal", &summary.t_test.contact),
        ("success: touch over blind", &summary.t_test.success),
        ("clean success: touch over blind", &summary.t_test.clean_success),
        ("clean success: touch over reflex", &summary.t_test.touch_over_reflex),
    ] {
        println!("{name:32} t({}) = {}, p = {}", t.df, number(t.t, 2), t.p.map_or("-".into(), |p| format!("{p:.2e}")));
    }
    for ablation in &summary.ablations {
        println!(
            "{:34} success {} [{}, {}], {:+.3} against the whole hand",
            ablation.ablation.label(),
            number(ablation.success.value, 3),
            number(ablation.success.low, 3),
            number(ablation.success.high, 3),
            ablation.against_full.value.unwrap_or(f64::NAN)
        );
    }
    let over = summary.decision_ms.over_budget.filter(|over| *over > 0);
    println!(
        "decision {} ms p50, {} ms p99{}",
        number(summary.decision_ms.p50, 1),
        number(summary.decision_ms.p99, 1),
        over.map_or(String::new(), |over| format!("; in {over} trials longer than the scenario gives it")),
    );
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
        "results in {}: report.html, summary.json, trials.csv, tries.csv{}",
        folder.display(),
        if recorded(folder) { format!("; see a trial with `ftac view {}`", folder.display()) } else { String::new() }
    );
    Ok(())
}
