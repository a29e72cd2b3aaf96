//! `ftac demo`: one trial, touch beside blind, in the viewer or as a page with a film.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use bench::builtin::make_bench;
use bench::recording::{Recording, TimeOrigin};
use bench::trial::filming::{self, COMPARED_CONDITIONS, Filming, Watchers};
use clap::Args;
use maud::html;
use report::film::{self, Film, FilmStage};
use report::picture;
use robot_backends::TrialTask;
use scenarios::{Scenario, TrialRecord};
use schemars::JsonSchema;
use serde::Serialize;
use telemetry::RecordingTarget;
use telemetry::viewer;

use crate::options::combination::combination_number;
use crate::options::robot::RobotArgs;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Number of the combination, from 0.
    #[arg(default_value_t = 0, value_parser = combination_number)]
    pub combination: usize,
    /// Number of the trial, from 0.
    #[arg(long, default_value_t = 0)]
    pub trial: usize,
    /// Folder for the film, the page, the strips of stills and the recordings.
    #[arg(long, default_value = "recordings/demo")]
    pub out: PathBuf,
    /// Only write files, even if a viewer is installed.
    #[arg(long)]
    pub no_viewer: bool,
    #[command(flatten)]
    pub robot: RobotArgs,
}

/// JSON output of `demo`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct DemoOutput<'a> {
    /// File of the page (HTML).
    page: &'a Path,
    trials: &'a [TrialRecord],
}

/// Runs one trial under blind and touch with the same errors, and shows both.
pub fn run(terminal: &Terminal, args: &DemoArgs) -> Outcome {
    let quiet = terminal.quiet || terminal.json;
    let robot = args.robot.model()?;
    let combos = (args.combination + 1).min(60);
    let bench = make_bench(&robot, Scenario::benchmark(), combos, terminal.seed, quiet)?;
    let Some(plan) = bench.grasp_pairs.pairs.get(args.combination) else {
        bail!("COMBO: found {}, expected 0 to {}", args.combination, bench.grasp_pairs.pairs.len() - 1);
    };
    std::fs::create_dir_all(&args.out).with_context(|| args.out.display().to_string())?;
    let program = if args.no_viewer { None } else { viewer::find() };
    let mut recordings = Vec::new();
    for condition in COMPARED_CONDITIONS {
        let mut targets = vec![RecordingTarget::File(args.out.join(format!("{condition}.rrd")))];
        targets.extend(program.is_some().then_some(RecordingTarget::Spawn));
        let task = TrialTask {
            images_throughout: true,
            scenario: scenarios::scenario::BENCHMARK_TOML.to_owned(),
            robot_model: robot.sources.clone(),
            ..TrialTask::new("sim", terminal.seed, [args.combination, args.trial, combos], condition)
        };
        recordings.push(Recording::open(&targets, &bench, &task, (TimeOrigin::Never, true))?);
    }
    let mut films = COMPARED_CONDITIONS.map(|condition| Filming::for_animation(&bench, condition));
    let mut watchers = Watchers(Vec::new());
    watchers.0.extend(recordings.iter_mut().map(|one| one as _));
    watchers.0.extend(films.iter_mut().map(|one| one as _));
    let results = bench.run_each_condition(args.combination, args.trial, &COMPARED_CONDITIONS, &[], &mut watchers)?;
    recordings.into_iter().try_for_each(Recording::finish)?;
    let stage = filming::film_stage(&bench, args.combination)?;
    let films = films.map(|filming| filming.film);
    let page = write_page(&stage, &films, args, (terminal.seed, [&plan.first, &plan.second]), quiet)?;
    print_output(terminal, &results.records, &page)?;
    if program.is_none() && !quiet {
        eprintln!("no viewer: open {} in a browser", page.display());
    }
    Ok(None)
}

/// Writes the film, the page and the strips of stills. Returns the page's path.
fn write_page(
    stage: &FilmStage,
    films: &[Film],
    args: &DemoArgs,
    (seed, names): (u64, [&String; 2]),
    quiet: bool,
) -> Result<PathBuf> {
    let (count, size) = film::STRIP_LAYOUT;
    for film in films {
        let file = args.out.join(format!("{}.png", film.title));
        picture::save(&stage.strip(film, count, size), &file)?;
    }
    let angles = vec![0.25; stage.hand.tree.len()];
    let view = picture::View::palm().enclosing(&picture::hand_points(stage.hand, &angles));
    let mut hand = picture::Picture::new(420, view);
    hand.hand_with(stage.hand, &angles, picture::configuration_color);
    let caption = format!("{} hand", stage.hand.parameters.handedness);
    picture::save(&hand.finish(&caption), &args.out.join("hand.png"))?;
    let [first, second] = names.map(|name| name.replace('_', " "));
    let about = html! {
        p {
            "The hand takes the " (first) " with ring and little finger, keeps it, and takes the " (second) " with thumb, index and middle finger. \
            Arm and detector err by some millimetres, equally in both films. " b { "Blind" } " executes the planned grasps. " b { "Touch" } " lowers the hand onto each \
            object until a pad detects contact, estimates the pose of the first one in the hand from the tactile images, and chooses the grasp and \
            the aim with the best outcome probabilities."
        }
        p {
            "The hand and the task are those of Zhao et al., "
            i { "Embedding high-resolution touch across robotic hands enables adaptive human-like grasping" }
            ", Nature Machine Intelligence, 2025 ("
            a href="https://doi.org/10.1038/s42256-025-01053-3" { "doi:10.1038/s42256-025-01053-3" }
            "). This is a simulation, and one trial gives no success rates: " code { "ftac bench" } " does."
        }
        p {
            "The film runs at " (film::SPEED) " times the speed of the trial. Below the scene are the changes of the tactile images against the untouched pads, a column for each \
            digit with its tip on top, the palm below; a pad that feels something has an orange frame. Beside them are the controller's notes. "
            "Made by " code { "ftac demo " (args.combination) " --trial " (args.trial) " --seed " (seed) }
            "; the recordings beside this page open with " code { "ftac view" } "."
        }
    };
    let title = format!("{first}, then {second}: blind beside touch");
    let animation = stage.animation(films, quiet)?;
    ftac_platform::data::write_atomically(&args.out.join(film::FILE), &animation)?;
    let html = film::page(films, &animation, (&title, &about));
    let page = args.out.join("index.html");
    ftac_platform::data::write_atomically(&page, html.as_bytes())?;
    Ok(page)
}

fn print_output(terminal: &Terminal, records: &[TrialRecord], page: &Path) -> Result<()> {
    let mut text = String::new();
    for record in records {
        let contact = if record.contact { ", with an unwanted contact" } else { "" };
        let cause = record.cause.map_or(String::new(), |cause| format!(" ({cause})"));
        let outcome = if record.success { "both objects held".to_owned() } else { format!("failed{cause}") };
        text += &format!("{:6} {outcome}{contact}\n", record.condition.name());
    }
    let [film, recordings] = [film::FILE, "*.rrd"].map(|name| page.with_file_name(name).display().to_string());
    text += &format!("{}: the film and the notes; {film}: the film; {recordings}: the recordings\n", page.display());
    terminal.print(&DemoOutput { page, trials: records }, &text)
}
