//! `ftac grasps classify`: one of the 19 types for every grasp, by rules, with the reasons on demand.

use clap::Args;
use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use serde::Serialize;
use serde_json::json;
use study::labels::{Agreement, Labels, agreement};
use study::rules::Distribution;
use study::taxonomy::Category;

use super::distribution;
use super::source::GraspsArgs;
use super::source::Source;
use crate::terminal::Outcome;
use crate::terminal::Terminal;
use report::write_whole;

/// Arguments of `grasps classify`.
#[derive(Debug, Args)]
pub struct ClassifyArgs {
    #[command(flatten)]
    pub grasps: GraspsArgs,
    /// Say why this grasp (`object/chain`) has its type, condition by condition.
    #[arg(long)]
    pub explain: Option<String>,
    /// Labels exported by the annotation page: agreement with the rules, and between annotators (repeatable).
    #[arg(long)]
    pub labels: Vec<PathBuf>,
    /// Folder for types.svg and classes.json.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Two raters' agreement, on types and on broad types.
#[derive(Debug, Serialize)]
struct Pair {
    first: String,
    second: String,
    types: Agreement,
    categories: Agreement,
}

/// `ftac grasps classify`.
pub fn run(terminal: &Terminal, args: &ClassifyArgs) -> Outcome {
    let source = Source::read(&args.grasps.paths)?;
    if let Some(id) = &args.explain {
        return explain(terminal, &source, id);
    }
    let pairs = agreements(&source, &args.labels)?;
    let decisions = source.entries.iter().map(|entry| (source.object(entry), &entry.decision));
    let found = Distribution::of(&source.taxonomy, decisions);
    let (totals, categories) = (found.totals(), found.categories(&source.taxonomy));
    let ambiguous: usize = found.ambiguous.iter().sum();
    let clear = |kind: usize| {
        source.entries.iter().filter(|entry| entry.decision.kind == kind && !entry.decision.ambiguous).count()
    };
    let fits = |kind: usize| {
        source.entries.iter().filter(|entry| entry.decision.kind == kind && entry.decision.margin >= 0.0).count()
    };
    let unfit = source.entries.iter().filter(|entry| entry.decision.margin < 0.0).count();
    let present = totals.iter().filter(|count| **count > 0).count();
    let some = |of: &dyn Fn(usize) -> usize| (0..source.taxonomy.types.len()).filter(|kind| of(*kind) > 0).count();
    let (fitted, clearly) = (some(&fits), some(&clear));
    let types: Vec<_> = source
        .taxonomy
        .types
        .iter()
        .enumerate()
        .map(
            |(n, kind)| json!({ "name": kind.name, "category": kind.category, "grasps": totals[n], "fit": fits(n), "clear": clear(n) }),
        )
        .collect();
    let grasps: Vec<_> = source
        .entries
        .iter()
        .map(|entry| {
            let name = |kind: usize| &source.taxonomy.types[kind].name;
            let decision = &entry.decision;
            json!({
                "id": entry.id, "type": name(decision.kind), "category": source.taxonomy.types[decision.kind].category,
                "margin": round(decision.margin), "ambiguous": decision.ambiguous,
                "second": name(decision.second.0), "second_margin": round(decision.second.1),
            })
        })
        .collect();
    let answer = json!({
        "grasps": source.entries.len(), "objects": found.objects.len(), "types_present": present,
        "types_fitted": fitted, "types_clear": clearly,
        "ambiguous": ambiguous, "fit_no_type": unfit,
        "categories": { "power": categories[0], "intermediate": categories[1], "precision": categories[2] },
        "types": types, "by_object": found, "agreement": pairs, "decisions": grasps,
    });
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder).with_context(|| format!("--out {}", folder.display()))?;
        write_whole(&folder.join("classes.json"), serde_json::to_string(&answer)?.as_bytes())?;
        write_whole(&folder.join("types.svg"), distribution::svg(&source.taxonomy, &found).as_bytes())?;
    }
    if terminal.json {
        println!("{answer}");
    } else {
        let of = source.entries.len();
        println!(
            "{of} grasps of {} objects: {present} of 19 types present, {fitted} by grasps that meet all conditions, {clearly} by clear ones",
            found.objects.len()
        );
        println!("{:24} {:13} {:>7} {:>7} {:>7}", "type", "category", "grasps", "fit", "clear");
        for (n, kind) in source.taxonomy.types.iter().enumerate() {
            println!("{:24} {:13} {:>7} {:>7} {:>7}", kind.name, kind.category.name(), totals[n], fits(n), clear(n));
        }
        let share = |count: usize| 100.0 * count as f64 / of as f64;
        for (category, count) in Category::ALL.iter().zip(categories) {
            println!("{:24} {:13} {count:>7} ({:.1} %)", "all", category.name(), share(count));
        }
        println!("ambiguous {ambiguous} ({:.1} %), of them {unfit} fit no type's conditions", share(ambiguous));
        for pair in &pairs {
            let kappa = |found: &Agreement| found.kappa.map_or("none".into(), |kappa| format!("{kappa:.3}"));
            println!(
                "{} and {}: {} grasps, types agree {:.1} %, kappa {}; broad types {:.1} %, kappa {}",
                pair.first,
                pair.second,
                pair.types.items,
                100.0 * pair.types.observed,
                kappa(&pair.types),
                100.0 * pair.categories.observed,
                kappa(&pair.categories)
            );
        }
    }
    Ok((present < 19).then(|| format!("{present} of the 19 types are present")))
}

fn round(margin: f64) -> f64 {
    (margin.max(-99.0) * 1e3).round() / 1e3
}

fn explain(terminal: &Terminal, source: &Source, id: &str) -> Outcome {
    let Some(entry) = source.find(id) else {
        let known: Vec<&str> = source.entries.iter().take(3).map(|entry| entry.id.as_str()).collect();
        bail!("--explain: found {id:?}, expected one of {} grasps such as {}", source.entries.len(), known.join(", "));
    };
    let decision = &entry.decision;
    let types = &source.taxonomy.types;
    let why = |kind: usize| source.rules.explain(kind, &entry.attributes);
    if terminal.json {
        println!(
            "{}",
            json!({
                "id": entry.id, "type": types[decision.kind].name, "margin": decision.margin,
                "ambiguous": decision.ambiguous, "conditions": why(decision.kind),
                "second": types[decision.second.0].name, "second_margin": decision.second.1,
                "second_conditions": why(decision.second.0),
            })
        );
        return Ok(None);
    }
    let verdict = if decision.ambiguous { ", ambiguous" } else { "" };
    println!("{}: {} (margin {:.2}{verdict})", entry.id, types[decision.kind].name, decision.margin);
    for kind in [decision.kind, decision.second.0] {
        if kind != decision.kind {
            println!("next best: {} (margin {:.2})", types[kind].name, decision.second.1);
        }
        for check in why(kind) {
            let mark = if check.margin < 0.0 {
                "no "
            } else if check.margin < source.rules.clear {
                "bare"
            } else {
                "yes"
            };
            println!(
                "  {mark:4} {:16} {:6.2}, asked {:12} margin {:5.2}  {}",
                check.attribute, check.value, check.bounds, check.margin, check.reason
            );
        }
    }
    Ok(None)
}

/// Agreement of every annotator with the rules and with every other annotator.
fn agreements(source: &Source, files: &[PathBuf]) -> Result<Vec<Pair>> {
    let known: BTreeSet<&str> = source.entries.iter().map(|entry| entry.id.as_str()).collect();
    let mut raters: Vec<(String, Labels)> = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(file).with_context(|| format!("--labels {}", file.display()))?;
        let labels = Labels::parse(&text, file, &source.taxonomy, &known).context("--labels")?;
        raters.push((labels.annotator.clone(), labels));
    }
    let kind = |labels: &Labels, id: &str| labels.labels.get(id).and_then(|name| source.taxonomy.find(name));
    let mut pairs = Vec::new();
    let mut compare = |first: &str, second: &str, rated: Vec<(usize, usize)>| {
        let category = |kind: usize| source.taxonomy.types[kind].category as usize;
        let broad: Vec<(usize, usize)> = rated.iter().map(|(a, b)| (category(*a), category(*b))).collect();
        if let (Some(types), Some(categories)) = (agreement(&rated, 19), agreement(&broad, 3)) {
            pairs.push(Pair { first: first.into(), second: second.into(), types, categories });
        }
    };
    for (n, (name, labels)) in raters.iter().enumerate() {
        let rated = source.entries.iter().filter_map(|entry| Some((kind(labels, &entry.id)?, entry.decision.kind)));
        compare(name, "rules", rated.collect());
        for (other, theirs) in &raters[..n] {
            let rated =
                source.entries.iter().filter_map(|entry| Some((kind(theirs, &entry.id)?, kind(labels, &entry.id)?)));
            compare(other, name, rated.collect());
        }
    }
    Ok(pairs)
}
