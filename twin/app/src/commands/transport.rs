//! `ftac transport`: carries balls to one place, as many per trip as the hand holds, and compares with one ball per
//! trip.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use bench::builtin::{HAND_UNIT, apply_hand_properties, simulated_touch_pipeline};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use control::policy::pick_sequence::PickMode;
use control::policy::pick_sequence::plan::PickSkill;
use dexterous_grasping::digit_sets::describe_digits;
use ftac_platform::file_access::folder_of;
use grasp_verification::simulated_world::SimulatedWorld;
use grasp_verification::skills::{SkillFile, for_sizes, from_repertoire};
use hand_model::{Digit, RobotModel};
use rayon::prelude::*;
use scenarios::Scenario;
use scenarios::effects::Effects;
use scenarios::transport::TransportTask;
use schemars::JsonSchema;
use serde::Serialize;
use sim::tactile::TactileBoard;
use statistics::MIN_SAMPLES;
use transport::recording::TransportRecording;
use transport::skill_search::{PickRequest, PickRequestText, SequencePickResult};
use transport::trial::{TransportRecord, TransportSite};

use crate::options::backend::BackendKind;
use crate::terminal::{Outcome, Terminal};

/// Result file of a folder.
const RESULT_FILE: &str = "transports.json";

/// Arguments of `transport`.
#[derive(Debug, Args)]
pub struct TransportArgs {
    /// Transport file (TOML); default: the built-in one with four small balls.
    #[arg(long)]
    pub scenario: Option<PathBuf>,
    /// Number of transports under each policy.
    #[arg(long, default_value_t = 10)]
    pub trials: usize,
    /// Policies to run; default: one by one, blind and touch.
    #[arg(long, value_delimiter = ',', value_parser = policies())]
    pub policy: Vec<PickMode>,
    /// File of additional skills, from --search-skills.
    #[arg(long)]
    pub skills: Option<PathBuf>,
    /// Result folder: transports.json, and a recording of the first transport under each policy.
    #[arg(long, conflicts_with = "search_skills")]
    pub out: Option<PathBuf>,
    /// Carry nothing; search skills for a sequence of picks in physics and add them to this file.
    #[arg(long, requires = "pick")]
    pub search_skills: Option<PathBuf>,
    /// A pick of the sequence to search, in order: BALL=DIGIT+DIGIT, such as ball_1=ring+little.
    #[arg(long, requires = "search_skills")]
    pub pick: Vec<PickRequestText>,
    /// Robot backend; transports run on the simulated robot only.
    #[arg(long, value_enum, default_value = "sim")]
    pub robot: BackendKind,
    /// Number of proposals for each pick.
    #[arg(long, default_value_t = 128, requires = "search_skills")]
    pub n: u32,
}

/// JSON output of `transport`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct TransportOutput<'a> {
    scenario: &'a str,
    /// Seed of all random draws.
    seed: u64,
    balls: usize,
    /// One entry per policy.
    policies: &'a [PolicyRow],
    transports: &'a [TransportRecord],
}

/// A skill that the search found.
#[derive(Debug, Serialize, JsonSchema)]
struct FoundSkill {
    /// Digits that hold the ball.
    #[schemars(with = "Vec<String>")]
    keeps: Vec<Digit>,
    score: f64,
}

/// Result of the search for one pick.
#[derive(Debug, Serialize, JsonSchema)]
struct PickSearchResult {
    ball: String,
    /// Digits that close.
    #[schemars(with = "Vec<String>")]
    closed: Vec<Digit>,
    /// Number of closings tried.
    tried: usize,
    /// Number of these that touched the ball.
    touched: usize,
    /// Number of these that lifted it.
    lifted: usize,
    /// Number of these that held it over the goal.
    held: usize,
    /// The best skills, most robust first.
    skills: Vec<FoundSkill>,
}

impl PickSearchResult {
    fn from_search(site: &TransportSite, pick: &SequencePickResult) -> Self {
        let skill = |skill: &PickSkill| FoundSkill { keeps: skill.keeps.clone(), score: skill.grasp.score };
        Self {
            ball: site.transport.ball[pick.request.ball].name.clone(),
            closed: pick.request.digits.clone(),
            tried: pick.tried,
            touched: pick.touched,
            lifted: pick.lifted,
            held: pick.held,
            skills: pick.skills.iter().map(skill).collect(),
        }
    }
}

/// JSON output of `transport --search-skills`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SkillSearchOutput<'a> {
    /// One entry per pick searched.
    picks: Vec<PickSearchResult>,
    /// Number of picks asked for.
    requested: usize,
    /// File of the skills.
    file: &'a Path,
}

/// Parses the name of a policy.
fn policies() -> impl TypedValueParser<Value = PickMode> {
    PossibleValuesParser::new(PickMode::ALL.map(PickMode::argument)).try_map(|name| name.parse::<PickMode>())
}

/// Runs `ftac transport`.
pub fn run(terminal: &Terminal, args: &TransportArgs) -> Outcome {
    if args.trials == 0 || args.n == 0 {
        bail!("--trials and --n: found {} and {}, expected at least 1 each", args.trials, args.n);
    }
    if args.robot != BackendKind::Sim {
        bail!(
            "--robot: found {}, expected sim: a transport detects all balls after each trip, which is possible only with the \
             simulated object detector",
            args.robot.name()
        );
    }
    let transport = match &args.scenario {
        Some(path) => TransportTask::read(path).context("--scenario")?,
        None => TransportTask::small_balls(),
    };
    let site = build_site(transport, args.skills.as_deref(), terminal.seed)?;
    match &args.search_skills {
        Some(file) => search_skills(terminal, args, &site, file),
        None => run_transports(terminal, args, &site),
    }
}

fn build_site(transport: TransportTask, more: Option<&Path>, seed: u64) -> Result<TransportSite> {
    let mut scenario = Scenario::benchmark();
    // The skills of transports were verified in rollouts without effects.
    scenario.effects = Effects::default();
    let world = SimulatedWorld::new(&RobotModel::ftac_gen3(), scenario)?;
    let repertoire = grasp_verification::builtin::repertoire()?;
    let mut verified = from_repertoire(&world, &repertoire)?;
    verified.extend(SkillFile::builtin()?.skills);
    if let Some(path) = more {
        verified.extend(read_skills(path).context("--skills")?.skills);
    }
    let mut sizes: Vec<f64> = Vec::new();
    let mut kind = Vec::new();
    for ball in &transport.ball {
        kind.push(sizes.iter().position(|size| *size == ball.diameter).unwrap_or_else(|| {
            sizes.push(ball.diameter);
            sizes.len() - 1
        }));
    }
    let numbered = for_sizes(&verified, &sizes);
    let of = |kind: usize| (0..numbered.len()).filter(|n| numbered[*n].0 == kind).collect();
    let suited = kind.into_iter().map(of).collect();
    let board = TactileBoard::unit(&world.cell.robot.hand, HAND_UNIT);
    let mut pipeline = simulated_touch_pipeline(&world.cell.robot, board.backgrounds())?;
    apply_hand_properties(&mut pipeline, &world);
    Ok(TransportSite {
        world,
        transport,
        skills: numbered.into_iter().map(|skill| skill.1).collect(),
        suitable_skills: suited,
        cameras: board,
        pipeline,
        seed,
    })
}

fn read_skills(path: &Path) -> Result<SkillFile> {
    let text = ftac_platform::file::read_text(path).with_context(|| path.display().to_string())?;
    SkillFile::parse(&text, path)
}

fn search_skills(terminal: &Terminal, args: &TransportArgs, site: &TransportSite, file: &Path) -> Outcome {
    let sequence: Vec<PickRequest> = args.pick.iter().map(|pick| pick.in_site(site)).collect::<Result<_>>()?;
    let mut skills = if file.exists() { read_skills(file).context("--search-skills")?.skills } else { Vec::new() };
    // The search takes minutes: a file that cannot be written is found before it.
    tempfile::tempfile_in(folder_of(file))
        .with_context(|| format!("--search-skills: cannot write {}", file.display()))?;
    let searched = transport::skill_search::search_skills(site, &sequence, args.n, terminal.quiet)?;
    for pick in &searched {
        // Ids are unique within a file.
        for skill in &pick.skills {
            let mut skill = skill.clone();
            skill.grasp.id = skills.len() as u32;
            skills.push(skill);
        }
    }
    let command = "ftac transport --search-skills FILE --pick ..., sequence after sequence".to_owned();
    SkillFile::new(command, skills).write(file)?;
    if terminal.json {
        let picks = searched.iter().map(|pick| PickSearchResult::from_search(site, pick)).collect();
        terminal.print(&SkillSearchOutput { picks, requested: sequence.len(), file }, "")?;
    } else {
        println!(
            "{:12} {:36} {:>6} {:>8} {:>7} {:>5} {:>6}  kept by",
            "ball", "closed", "tried", "touched", "lifted", "held", "best"
        );
        for pick in &searched {
            let best = pick.skills.first();
            println!(
                "{:12} {:36} {:>6} {:>8} {:>7} {:>5} {:>6}  {}",
                site.transport.ball[pick.request.ball].name,
                describe_digits(&pick.request.digits),
                pick.tried,
                pick.touched,
                pick.lifted,
                pick.held,
                best.map_or("-".to_owned(), |skill| format!("{:.2}", skill.grasp.score)),
                best.map_or("-".to_owned(), |skill| describe_digits(&skill.keeps)),
            );
        }
    }
    let failed = searched.last().filter(|pick| pick.held == 0);
    Ok(failed.map(|pick| {
        let name = &site.transport.ball[pick.request.ball].name;
        format!("none of {} closings of {} on {name} holds", pick.tried, describe_digits(&pick.request.digits))
    }))
}

fn run_transports(terminal: &Terminal, args: &TransportArgs, site: &TransportSite) -> Outcome {
    let mut policies = if args.policy.is_empty() { PickMode::ALL.to_vec() } else { Vec::new() };
    for policy in &args.policy {
        if !policies.contains(policy) {
            policies.push(*policy);
        }
    }
    if let Some(folder) = &args.out {
        let results = folder.join(RESULT_FILE);
        if results.exists() {
            bail!("--out: found the results of another run in {}, expected a new folder", results.display());
        }
        std::fs::create_dir_all(folder).with_context(|| format!("--out {}", folder.display()))?;
    }
    let units: Vec<(PickMode, usize)> =
        policies.iter().flat_map(|policy| (0..args.trials).map(move |trial| (*policy, trial))).collect();
    let bar = progress::bar(units.len() as u64, "trials", terminal.quiet);
    let one = |&(policy, trial): &(PickMode, usize)| -> Result<TransportRecord> {
        let record = match args.out.as_ref().filter(|_| trial == 0) {
            Some(folder) => {
                let mut recorded = TransportRecording::open(
                    &folder.join(format!("{}.rrd", policy.name().replace(' ', "_"))),
                    site,
                    trial,
                    policy,
                )?;
                let record =
                    site.run(trial, policy, &mut |truth, executor, note| recorded.record_tick(truth, executor, note))?;
                recorded.finish(&record)?;
                record
            }
            None => site.run(trial, policy, &mut |_, _, _| Ok(()))?,
        };
        bar.inc(1);
        Ok(record)
    };
    let records: Vec<TransportRecord> = units.par_iter().map(one).collect::<Result<_>>()?;
    bar.finish_and_clear();
    let rows: Vec<PolicyRow> = policies.iter().map(|policy| PolicyRow::from_records(*policy, &records)).collect();
    let result = TransportOutput {
        scenario: &site.transport.name,
        seed: terminal.seed,
        balls: site.transport.ball.len(),
        policies: &rows,
        transports: &records,
    };
    if let Some(folder) = &args.out {
        ftac_platform::data::write_atomically(
            &folder.join(RESULT_FILE),
            serde_json::to_string_pretty(&result)?.as_bytes(),
        )?;
    }
    if terminal.json {
        terminal.print(&result, "")?;
    } else {
        print(terminal, site, &rows, &records);
    }
    let carried = |policy| rows.iter().find(|row| row.policy == policy).map(|row| row.objects_per_trip);
    // With few transports, policies are not compared.
    let enough = args.trials >= MIN_SAMPLES;
    Ok(match (carried(PickMode::Touch), carried(PickMode::OneByOne)) {
        (Some(touch), Some(single)) if enough && touch <= single => {
            Some(format!("{touch:.2} objects a trip together, {single:.2} one by one"))
        }
        _ => None,
    })
}

fn print(terminal: &Terminal, site: &TransportSite, rows: &[PolicyRow], records: &[TransportRecord]) {
    println!("{}: {} balls, {} skills", site.transport.name, site.transport.ball.len(), site.skills.len());
    println!(
        "{:12} {:>10} {:>9} {:>11} {:>10} {:>9} {:>12} {:>12}",
        "policy", "transports", "delivered", "objects/trip", "most/trip", "picks", "s per object", "cm3 per trip"
    );
    for row in rows {
        println!(
            "{:12} {:>10} {:>8.0}% {:>12.2} {:>10} {:>9} {:>12} {:>12.0}",
            row.policy.name(),
            row.transports,
            100.0 * row.delivered,
            row.objects_per_trip,
            row.max_per_trip,
            row.picks,
            row.seconds_per_object.map_or("-".to_owned(), |seconds| format!("{seconds:.1}")),
            row.cm3_per_trip
        );
    }
    let shown = if terminal.verbose { records.len() } else { 0 };
    for record in records.iter().take(shown).chain(records.iter().filter(|record| shown == 0 && record.trial == 0)) {
        println!("{} {}:", record.policy.name(), record.trial);
        for line in &record.events {
            println!("  {line}");
        }
    }
}

/// Results of one policy.
#[derive(Debug, Clone, Serialize, JsonSchema)]
struct PolicyRow {
    /// The policy.
    #[schemars(with = "String")]
    policy: PickMode,
    transports: usize,
    /// Share of all balls that reached the goal in the hand.
    delivered: f64,
    /// Mean number of objects in the hand over the goal, per trip.
    objects_per_trip: f64,
    max_per_trip: usize,
    picks: usize,
    /// Simulated time per delivered object, s; none if none was delivered.
    seconds_per_object: Option<f64>,
    cm3_per_trip: f64,
}

impl PolicyRow {
    fn from_records(policy: PickMode, records: &[TransportRecord]) -> Self {
        let own: Vec<&TransportRecord> = records.iter().filter(|record| record.policy == policy).collect();
        let trips: Vec<usize> = own.iter().flat_map(|record| record.carried.iter().copied()).collect();
        let objects: usize = trips.iter().sum();
        let balls: usize = own.iter().map(|record| record.balls).sum();
        let per_trip = |value: f64| if trips.is_empty() { 0.0 } else { value / trips.len() as f64 };
        Self {
            policy,
            transports: own.len(),
            delivered: objects as f64 / balls.max(1) as f64,
            objects_per_trip: per_trip(objects as f64),
            max_per_trip: trips.iter().copied().max().unwrap_or(0),
            picks: own.iter().map(|record| record.picks).sum(),
            seconds_per_object: (objects > 0)
                .then(|| own.iter().map(|record| record.seconds).sum::<f64>() / objects as f64),
            cm3_per_trip: per_trip(own.iter().map(|record| record.volume_cm3).sum()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(policy: PickMode, carried: &[usize], seconds: f64) -> TransportRecord {
        TransportRecord {
            policy,
            trial: 0,
            balls: 4,
            carried: carried.to_vec(),
            names: Vec::new(),
            volume_cm3: 40.0 * carried.iter().sum::<usize>() as f64,
            picks: 5,
            seconds,
            events: Vec::new(),
        }
    }

    #[test]
    fn rows_add_up() {
        let records = [
            record(PickMode::Touch, &[2, 1], 30.0),
            record(PickMode::Touch, &[2, 2], 26.0),
            record(PickMode::OneByOne, &[], 0.0),
        ];
        let touch = PolicyRow::from_records(PickMode::Touch, &records);
        assert_eq!((touch.objects_per_trip, touch.max_per_trip, touch.delivered), (1.75, 2, 0.875));
        assert_eq!((touch.seconds_per_object, touch.cm3_per_trip), (Some(8.0), 70.0));
        let single = PolicyRow::from_records(PickMode::OneByOne, &records);
        assert_eq!((single.objects_per_trip, single.seconds_per_object), (0.0, None));
    }
}
