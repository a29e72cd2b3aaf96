//! `ftac grasps annotate`: writes the page on which people assign types to grasps.

use std::path::Path;

use anyhow::ensure;
use ftac::lab::arguments::grasps::AnnotateArgs;
use ftac::terminal::{Outcome, Terminal};
use ftac_platform::data::write_atomically;
use lab::study_pages::annotation;
use lab::study_pages::scene::PageScene;
use schemars::JsonSchema;
use serde::Serialize;

use super::source::{GraspSource, check_output_folder};

/// Output once the page is written.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Annotation<'a> {
    /// Path of the page (HTML).
    page: &'a Path,
    grasps: usize,
    /// Size of the file, bytes.
    bytes: usize,
}

/// Runs `ftac grasps annotate`.
pub fn run(terminal: &Terminal, args: &AnnotateArgs) -> Outcome {
    check_output_folder(&args.out)?;
    let GraspSource { hand, objects, classification } = GraspSource::read(&args.grasps.paths)?;
    let all = classification.grasps.len();
    let count = args.n.unwrap_or(all).min(all);
    ensure!(count > 0, "--n: found 0, expected at least 1");
    let scene = PageScene::from_grasps(&hand, &objects, (0..count).map(|n| &classification.grasps[n * all / count]));
    let title = format!("{count} of {all} grasps, {} objects", objects.len());
    let page = annotation::page(&classification.taxonomy, &scene, &title)?;
    write_atomically(&args.out, page.as_bytes())?;
    let megabytes = page.len() as f64 / 1e6;
    terminal.print(
        &Annotation { page: &args.out, grasps: count, bytes: page.len() },
        &format!("{count} grasps, {megabytes:.1} MB: open {} in a browser\n", args.out.display()),
    )?;
    Ok(None)
}
