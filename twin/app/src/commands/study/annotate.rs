//! `ftac grasps annotate`: the page on which people give grasps their types.

use anyhow::bail;
use clap::Args;
use std::path::PathBuf;
use study::page::annotation;

use super::source::GraspsArgs;
use super::source::{Source, writable};
use crate::terminal::Outcome;
use crate::terminal::Terminal;
use report::write_whole;

/// Arguments of `grasps annotate`.
#[derive(Debug, Args)]
pub struct AnnotateArgs {
    #[command(flatten)]
    pub grasps: GraspsArgs,
    /// Grasps on the page at most, taken evenly from all; default: all.
    #[arg(long)]
    pub n: Option<usize>,
    /// The page to write.
    #[arg(long)]
    pub out: PathBuf,
}

/// `ftac grasps annotate`.
pub fn run(terminal: &Terminal, args: &AnnotateArgs) -> Outcome {
    writable(&args.out)?;
    let source = Source::read(&args.grasps.paths)?;
    let all = source.entries.len();
    let count = args.n.unwrap_or(all).min(all);
    if count == 0 {
        bail!("--n: found 0, expected at least 1");
    }
    let scene = source.scene((0..count).map(|n| &source.entries[n * all / count]));
    let title = format!("{count} of {all} grasps, {} objects", source.objects.len());
    let page = annotation::page(&source.taxonomy, &scene, &title)?;
    write_whole(&args.out, page.as_bytes())?;
    if terminal.json {
        println!("{}", serde_json::json!({ "page": args.out, "grasps": count, "bytes": page.len() }));
    } else {
        println!("{count} grasps, {:.1} MB: open {} in a browser", page.len() as f64 / 1e6, args.out.display());
    }
    Ok(None)
}
