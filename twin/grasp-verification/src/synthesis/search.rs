//! Search for one object: chains run in batches, each is closed and checked, and verified grasps are written as they
//! are found.

use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use dexterous_grasping::synthesis::grasp_file::GraspWriter;
use dexterous_grasping::synthesis::held::{HeldGrasp, VerifiedLoad};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;

use super::closing::ClosingFailure;
use super::object_properties::ObjectProperties;
use super::record;
use super::report::SynthesisReport;
use super::synthesizer::{ChainResult, CheckedGrasp, Synthesizer};

/// Number of chains between two writes to the file. All threads have work, and an interruption loses little.
const BATCH_SIZE: u64 = 32;

/// Start of a search, from nothing or from an interrupted search.
#[derive(Debug, Default)]
pub struct SearchStart {
    /// Number of the first chain.
    pub chain: u64,
    /// Grasps found before it.
    pub kept: Vec<HeldGrasp>,
}

/// Runs all chains. Every verified grasp that is not a near duplicate goes to `writer` when its batch is done. Returns
/// the report and all grasps kept.
pub fn search(
    synthesizer: &Synthesizer<'_>,
    from: SearchStart,
    mut writer: Option<GraspWriter>,
    progress: &ProgressBar,
) -> Result<(SynthesisReport, Vec<HeldGrasp>)> {
    let start = Instant::now();
    let Synthesizer { hand, subject, request, .. } = synthesizer;
    let model = &subject.model;
    let surface = &hand.sampled.surface;
    let (candidates, surface_points) = (surface.candidates.len(), surface.len());
    let mut report = SynthesisReport { object: model.name.clone(), candidates, surface_points, ..record::report(hand) };
    show_chains(progress, &model.name, request.chains)?;
    progress.set_position(from.chain);
    let (mut steps, mut sampling_s) = (0, 0.0);
    let mut kept = from.kept;
    for first in (from.chain..request.chains).step_by(BATCH_SIZE as usize) {
        if kept.len() >= request.max_grasps {
            break;
        }
        let chains = first..(first + BATCH_SIZE).min(request.chains);
        let results: Vec<(u64, ChainResult)> =
            chains.into_par_iter().map(|chain| Ok((chain, synthesizer.run(chain)?))).collect::<Result<_>>()?;
        let before = kept.len();
        let mut fresh: Vec<&CheckedGrasp> = Vec::new();
        for (chain, result) in &results {
            steps += result.steps;
            sampling_s += result.sampling_s;
            report.requested += 1;
            report.closings += result.closings as u64;
            progress.inc(1);
            report.plain += u64::from(result.plain.as_ref().is_ok_and(CheckedGrasp::verified));
            let checked = match result.grasp() {
                Ok(checked) => checked,
                Err(ClosingFailure::Blocked) => {
                    report.blocked += 1;
                    continue;
                }
                Err(ClosingFailure::PushedAway) => {
                    report.pushed_away += 1;
                    continue;
                }
            };
            report.found += 1;
            report.verified.add(checked.verdicts());
            if let (Some(refusal), Some(judgement)) = (checked.refusal, &mut report.judgement) {
                judgement.refused.add(refusal);
                report.verified.all -= 1;
            }
            if !checked.verified() {
                continue;
            }
            record::count(hand, checked, &mut report);
            let grasp = record::to_held_grasp(hand, subject, *chain, checked);
            if let Some(of_type) = synthesizer.is_of_wanted_type(|| grasp.clone()) {
                *report.of_type.get_or_insert(0) += u64::from(of_type);
                if !of_type {
                    continue;
                }
            }
            if kept.iter().any(|other| other.nearly_equals(&grasp, |a, b| model.symmetry.angle(a, b))) {
                report.duplicates += 1;
            } else if kept.len() < request.max_grasps {
                kept.push(grasp);
                fresh.push(checked);
            }
        }
        // The verified load costs more than all earlier steps, so only the grasps that are kept get one.
        kept[before..].par_iter_mut().zip(fresh).for_each(|(grasp, checked)| {
            let verification: VerifiedLoad = synthesizer.verified_load(checked);
            record::add_verification(hand, checked, verification, grasp);
        });
        if let Some(writer) = &mut writer {
            for grasp in &kept[before..] {
                writer.add(&grasp.clone().with_frame_moved(&subject.origin).at_file_precision())?;
            }
        }
        progress.set_message(report.verified.all.to_string());
    }
    progress.finish_and_clear();
    report.kept = kept.len();
    if let Some(judgement) = &mut report.judgement {
        let slack = kept.iter().filter(|grasp| grasp.held_without_tension == Some(true));
        judgement.held_without_tension = slack.count() as u64;
    }
    let payloads = kept.iter().filter_map(|grasp| Some(grasp.verified_load?.payload));
    report.load = ObjectProperties::summarize(model, payloads);
    report.wall_s = start.elapsed().as_secs_f64();
    report.grasp_steps_per_s = steps as f64 / sampling_s.max(1e-9);
    report.notes.extend(report.opposition_warning());
    Ok((report, kept))
}

/// Sets up `progress` for a search of this number of chains for an object.
fn show_chains(progress: &ProgressBar, object: &str, chains: u64) -> Result<()> {
    progress.set_length(chains);
    let template = format!("{object:16} {{bar:30}} {{pos}}/{{len}} chains, {{msg}} verified [{{elapsed}} < {{eta}}]");
    progress.set_style(ProgressStyle::with_template(&template)?);
    progress.set_message("0");
    Ok(())
}

/// Reads `--contacts`: `5` or `2-5`.
pub fn parse_contacts(text: &str) -> Result<(usize, usize)> {
    let most = dexterous_grasping::synthesis::energy::MAX_CONTACTS;
    let (low, high) = text.split_once('-').unwrap_or((text, text));
    match (low.parse::<usize>(), high.parse::<usize>()) {
        (Ok(low), Ok(high)) if 2 <= low && low <= high && high <= most => Ok((low, high)),
        _ => anyhow::bail!("--contacts: found `{text}`, expected a number from 2 to {most} or a range such as 2-5"),
    }
}

/// Checks that a result file can be created, before any work is done.
pub fn check_writable(path: &Path) -> Result<()> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        anyhow::ensure!(
            folder.is_dir(),
            "--out {}: found no folder {}, expected one",
            path.display(),
            folder.display()
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hand_model::Hand;

    use super::super::grasping_hand::GraspingHand;
    use super::super::report::CheckCounts;
    use super::super::subject::PreparedObject;
    use super::super::synthesizer::SynthesisRequest;
    use super::*;

    fn verified(threads: usize) -> (CheckCounts, Vec<String>) {
        let request = SynthesisRequest {
            chains: 6,
            max_grasps: usize::MAX,
            contacts: (5, 5),
            closings: 4,
            seed: 3,
            table: false,
        };
        let hand = GraspingHand::from_hand(Arc::new(Hand::ftac()));
        let synthesizer = Synthesizer::new(&hand, PreparedObject::from_set("ball").expect("the ball"), request);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("held.jsonl");
        let header = dexterous_grasping::synthesis::grasp_file::GraspFileHeader::new(String::new(), 3);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let writer = GraspWriter::create(&path, &header).expect("created");
        let (report, _) = pool
            .install(|| search(&synthesizer, SearchStart::default(), Some(writer), &ProgressBar::hidden()))
            .expect("searched");
        let lines = std::fs::read_to_string(&path).expect("read").lines().map(str::to_owned).collect();
        (report.verified, lines)
    }

    /// Any number of threads finds the same grasps, to the last digit and in the same order.
    #[test]
    fn same_grasps_on_one_and_two_threads() {
        let (one, two) = (verified(1), verified(2));
        assert_eq!(one, two);
        assert!(one.0.all > 0, "something was found: {:?}", one.0);
    }

    #[test]
    fn contacts_are_read() {
        assert_eq!(parse_contacts("5").expect("good"), (5, 5));
        assert_eq!(parse_contacts("2-5").expect("good"), (2, 5));
        for bad in ["1", "9", "5-2", "x", "2-"] {
            assert!(parse_contacts(bad).expect_err("bad").to_string().contains("--contacts"));
        }
    }
}
