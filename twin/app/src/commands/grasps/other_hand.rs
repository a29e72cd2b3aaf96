//! `ftac grasps generate --hand`: grasps for a hand that is known from its URDF alone.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use proving::synthesis::any::{AnyReport, describe, search};
use proving::synthesis::search as ours;
use proving::synthesis::subject::Subject;
use proving::synthesis::workshop::Request;

use crate::terminal::Outcome;
use crate::terminal::Terminal;

/// Searches grasps of `subject` for the hand of `urdf` and `pulls`.
pub fn generate(
    terminal: &Terminal,
    (urdf, pulls): (&Path, &Path),
    subject: &Subject,
    request: &Request,
    out: Option<&PathBuf>,
) -> Outcome {
    let hand = describe::read(urdf, pulls)?;
    if !terminal.json {
        hand.story.iter().for_each(|line| eprintln!("{line}"));
    }
    if let Some(out) = out {
        ours::check_writable(out)?;
    }
    let (report, held) = search(&hand, subject, request)?;
    if let Some(out) = out {
        let mut lines = Vec::new();
        for grasp in &held {
            serde_json::to_writer(&mut lines, grasp)?;
            lines.write_all(b"\n")?;
        }
        report::write_whole(out, &lines)?;
    }
    tell(terminal, &report)?;
    let nothing = format!("no grasp of {} was verified in {} chains", report.object, report.requested);
    Ok((report.verified.all == 0).then_some(nothing))
}

fn tell(terminal: &Terminal, report: &AnyReport) -> Result<()> {
    if terminal.json {
        println!("{}", serde_json::to_string(report)?);
        return Ok(());
    }
    let share = |count: u64| format!("{count:5} ({:.1} %)", 100.0 * count as f64 / report.requested as f64);
    println!(
        "{} on {}: {} chains, {:.1} s, {} surface points, {} candidates",
        report.hand, report.object, report.requested, report.wall_s, report.surface_points, report.candidates
    );
    println!("closed            {}", share(report.found));
    println!("  blocked         {}", share(report.blocked));
    println!("  pushed away     {}", share(report.pushed_away));
    println!("(a) cone program  {}", share(report.verified.a));
    println!("(b) penetration   {}", share(report.verified.b));
    println!("(c) held          {}", share(report.verified.c));
    println!("all three         {}", share(report.verified.all));
    println!("  of these held without tension {}", report.held_without_tension);
    Ok(())
}
