//! `ftac grasps classify`: assigns one of the 19 types to every grasp by rules, with the reasons on demand.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use dexterous_grasping::synthesis::collection::{Collection, CollectionHeader, ObjectGrasps, SearchSummary, VERSION};
use dexterous_grasping::synthesis::held::HeldGrasp;
use ftac::lab::arguments::grasps::ClassifyArgs;
use ftac::options::output_file::check_other_file;
use ftac::terminal::{CommandOutput, Outcome, Terminal};
use ftac_platform::data::write_atomically;
use grasp_analysis::classification::Classification;
use grasp_analysis::explanation::{self, Explanation};
use grasp_analysis::labels::Labels;
use grasp_analysis::people::{self, HumanGraspShares};
use grasp_analysis::raters::{RaterPair, agreements};
use grasp_analysis::summary::{self, ClassificationFigures};
use lab::study_pages::types;
use report::chart;

use super::pick_ups;
use super::source::GraspSource;

/// Runs `ftac grasps classify`.
pub fn run(terminal: &Terminal, args: &ClassifyArgs) -> Outcome {
    if let Some(file) = &args.pairs {
        return terminal.print_result(pick_ups::make(terminal, file)?);
    }
    match &args.explain {
        Some(id) => explain(terminal, &GraspSource::read(&args.grasps.paths)?.classification, id),
        None => terminal.print_result(make(args)?),
    }
}

/// Classifies all grasps.
pub fn make(args: &ClassifyArgs) -> Result<CommandOutput<ClassificationFigures>> {
    if let Some(file) = &args.like_people {
        check_other_file("--like-people", file, args.grasps.paths.iter().map(PathBuf::as_path))?;
    }
    let classification = GraspSource::read(&args.grasps.paths)?.classification;
    let mut choice = String::new();
    if let Some(file) = &args.like_people {
        choice = write_selection(&classification, file)?;
    }
    let pairs = agreements(&classification, &read_labels(&classification, &args.labels)?);
    let summary = summary::ClassificationSummary::from_classification(&classification);
    let agreement: String = pairs.iter().map(RaterPair::text).map(|line| line + "\n").collect();
    let answer = summary.figures(&classification, pairs);
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder).with_context(|| format!("--out {}", folder.display()))?;
        write_atomically(&folder.join("classes.json"), serde_json::to_string(&answer)?.as_bytes())?;
        let figure = types::svg(&classification.taxonomy, &summary.distribution);
        write_atomically(&folder.join("types.svg"), chart::standalone(&figure).as_bytes())?;
    }
    let (present, all) = (summary.present(), summary.types.len());
    Ok(CommandOutput {
        json: answer,
        text: summary.table(&classification) + &agreement + &choice,
        shortfall: (present < all).then(|| format!("{present} of the {all} types are present")),
    })
}

/// Writes a selection of grasps whose types have the same shares as people's, and describes it.
fn write_selection(classification: &Classification, file: &Path) -> Result<String> {
    let (grasps, people) = (&classification.grasps, HumanGraspShares::builtin(&classification.taxonomy));
    let types: Vec<usize> = grasps.iter().map(|grasp| grasp.decision.kind).collect();
    // Objects in turn, for each its clearest grasps first.
    let mut by_object: Vec<Vec<usize>> = vec![Vec::new(); classification.objects.len()];
    grasps.iter().enumerate().for_each(|(n, grasp)| by_object[grasp.object].push(n));
    for own in &mut by_object {
        own.sort_by(|a, b| grasps[*b].decision.margin.total_cmp(&grasps[*a].decision.margin));
    }
    let longest = by_object.iter().map(Vec::len).max().unwrap_or(0);
    let order: Vec<usize> =
        (0..longest).flat_map(|turn| by_object.iter().filter_map(move |own| own.get(turn))).copied().collect();
    let chosen = people.choose(&types, &order, grasps.len());
    let objects = classification.objects.iter().enumerate().map(|(number, object)| {
        let own = chosen.iter().filter(|grasp| grasps[**grasp].object == number);
        let own: Vec<HeldGrasp> = own.map(|grasp| grasps[*grasp].grasp.clone()).collect();
        let chains = own.iter().map(|grasp| grasp.chain + 1).max().unwrap_or(0);
        let summary =
            SearchSummary { object: object.clone(), requested: own.len(), kept: own.len(), chains, short: None };
        ObjectGrasps { summary, grasps: own }
    });
    let header = CollectionHeader { version: VERSION, command: "ftac grasps classify --like-people".into(), seed: 0 };
    let collection = Collection { header, objects: objects.collect() };
    write_atomically(file, collection.to_text()?.as_bytes())
        .with_context(|| format!("--like-people {}", file.display()))?;
    let mut counts = vec![0; classification.taxonomy.types.len()];
    chosen.iter().for_each(|grasp| counts[types[*grasp]] += 1);
    Ok(format!("{}: {} grasps\n{}", file.display(), chosen.len(), people::table(&people.compare(&counts))))
}

fn explain(terminal: &Terminal, classification: &Classification, id: &str) -> Outcome {
    let Some(grasp) = classification.find(id) else {
        let grasps = &classification.grasps;
        let known: Vec<&str> = grasps.iter().take(3).map(|grasp| grasp.id.as_str()).collect();
        bail!("--explain: found {id:?}, expected one of {} grasps such as {}", grasps.len(), known.join(", "));
    };
    terminal.print(&Explanation::new(classification, grasp), &explanation::text(classification, grasp))?;
    Ok(None)
}

/// Reads people's labels as exported by the annotation page.
fn read_labels(classification: &Classification, files: &[PathBuf]) -> Result<Vec<Labels>> {
    let known: BTreeSet<&str> = classification.grasps.iter().map(|grasp| grasp.id.as_str()).collect();
    let read = |file: &PathBuf| {
        let text = ftac_platform::file::read_text(file).with_context(|| format!("--labels {}", file.display()))?;
        Labels::parse(&text, file, &classification.taxonomy, &known).context("--labels")
    };
    files.iter().map(read).collect()
}
