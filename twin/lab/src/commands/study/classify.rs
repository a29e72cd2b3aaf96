//! `ftac grasps classify`: one of the 19 types for every grasp, by rules, with the reasons on demand.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use ftac::lab::arguments::grasps::ClassifyArgs;
use ftac::terminal::{Made, Outcome, Terminal};
use lab::study_pages::types;
use platform::data::write_whole;
use report::chart;
use study::classification::Classification;
use study::explanation::{self, Explanation};
use study::labels::Labels;
use study::raters::{RaterPair, agreements};
use study::summary::{Figures, Summary};

use super::source::Source;

/// `ftac grasps classify`.
pub fn run(terminal: &Terminal, args: &ClassifyArgs) -> Outcome {
    match &args.explain {
        Some(id) => explain(terminal, &Source::read(&args.grasps.paths)?.classification, id),
        None => terminal.finish(make(args)?),
    }
}

/// The types of all grasps.
pub fn make(args: &ClassifyArgs) -> Result<Made<Figures>> {
    let classification = Source::read(&args.grasps.paths)?.classification;
    let pairs = agreements(&classification, &labels(&classification, &args.labels)?);
    let summary = Summary::of(&classification);
    let agreement: String = pairs.iter().map(RaterPair::text).map(|line| line + "\n").collect();
    let answer = summary.figures(&classification, pairs);
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder).with_context(|| format!("--out {}", folder.display()))?;
        write_whole(&folder.join("classes.json"), serde_json::to_string(&answer)?.as_bytes())?;
        let figure = types::svg(&classification.taxonomy, &summary.distribution);
        write_whole(&folder.join("types.svg"), chart::standalone(&figure).as_bytes())?;
    }
    let (present, all) = (summary.present(), summary.types.len());
    Ok(Made {
        json: answer,
        text: summary.table(&classification) + &agreement,
        shortfall: (present < all).then(|| format!("{present} of the {all} types are present")),
    })
}

fn explain(terminal: &Terminal, classification: &Classification, id: &str) -> Outcome {
    let Some(grasp) = classification.find(id) else {
        let grasps = &classification.grasps;
        let known: Vec<&str> = grasps.iter().take(3).map(|grasp| grasp.id.as_str()).collect();
        bail!("--explain: found {id:?}, expected one of {} grasps such as {}", grasps.len(), known.join(", "));
    };
    terminal.print(&Explanation::of(classification, grasp), &explanation::text(classification, grasp))?;
    Ok(None)
}

/// The labels that people gave, as the annotation page exported them.
fn labels(classification: &Classification, files: &[PathBuf]) -> Result<Vec<Labels>> {
    let known: BTreeSet<&str> = classification.grasps.iter().map(|grasp| grasp.id.as_str()).collect();
    let read = |file: &PathBuf| {
        let text = platform::file::read_text(file).with_context(|| format!("--labels {}", file.display()))?;
        Labels::parse(&text, file, &classification.taxonomy, &known).context("--labels")
    };
    files.iter().map(read).collect()
}
