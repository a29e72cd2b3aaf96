//! The search for one object: chains run in batches, each is closed and checked, and verified grasps are written as they are found.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use grasping::synthesis::grasp_file::GraspWriter;
use grasping::synthesis::held::{HeldGrasp, Proof};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::closing::NotClosed;
use super::load::Load;
use super::synthesizer::{ChainResult, Checked, Synthesizer};
use super::urdf_hand::refusal::Refused;

/// Chains between two visits to the file: all threads have work, and an interruption loses little.
const BATCH: u64 = 32;

/// Counts of passed checks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Verified {
    /// Friction-cone margin.
    pub a: u64,
    /// Penetration.
    pub b: u64,
    /// Held against the six forces.
    pub c: u64,
    /// All three.
    pub all: u64,
}

impl Verified {
    /// Counts one more.
    pub fn add(&mut self, [a, b, c]: [bool; 3]) {
        self.a += u64::from(a);
        self.b += u64::from(b);
        self.c += u64::from(c);
        self.all += u64::from(a && b && c);
    }
}

/// Figures of a search with a hand whose surface and palm are found, not given.
#[derive(Debug, Clone, Default, Serialize, JsonSchema)]
pub struct Judgement {
    /// Grasps that passed all three checks and are none all the same.
    pub refused: Refused,
    /// Verified grasps in which two digits press against each other.
    pub opposed: u64,
    /// Largest distance of a verified grasp's contact from its link's own surface, m; where it is kept, it lies on that.
    pub surface_gap: f64,
    /// Verified grasps that still held when nothing pulled: has to be few.
    pub held_without_tension: u64,
}

/// What a search came to.
#[derive(Debug, Clone, Default, Serialize, JsonSchema)]
pub struct Report {
    pub hand: String,
    pub object: String,
    /// Contact candidates on the hand.
    pub candidates: usize,
    /// Points on the hand's surface.
    pub surface_points: usize,
    /// Chains run.
    pub requested: u64,
    /// Chains that ended in a closed grasp.
    pub found: u64,
    /// Chains whose posture could not be opened clear of the object.
    pub blocked: u64,
    /// Chains whose closing digits pushed the object away.
    pub pushed_away: u64,
    /// Closings tried in all.
    pub closings: u64,
    /// Chains whose first, plain closing passed all checks.
    pub plain: u64,
    /// Checks passed; all three by grasps that are not refused.
    pub verified: Verified,
    /// Verified grasps that nearly equal an earlier one; they are not written.
    pub duplicates: u64,
    /// Grasps kept and written.
    pub kept: usize,
    #[serde(flatten)]
    pub judgement: Option<Judgement>,
    /// Mass (kg) and friction for which grasps are verified, and how much those kept hold.
    pub load: Load,
    /// Wall time, s.
    pub wall_s: f64,
    /// Iterations of the sampler per second and thread.
    pub grasp_steps_per_s: f64,
    /// Digits used, by name, in verified grasps; none of a hand whose digits have no names.
    pub digits: BTreeMap<&'static str, u64>,
    /// What was found of the hand, in words; warnings begin with `WARNING`.
    pub notes: Vec<String>,
}

impl Report {
    /// A warning if the hand holds, but never between digits that oppose each other.
    fn opposition_warning(&self) -> Option<String> {
        let all = self.verified.all;
        let alike = all > 0 && self.judgement.as_ref().is_some_and(|judgement| judgement.opposed == 0);
        alike.then(|| {
            format!(
                "WARNING none of the {all} grasps uses opposed digits: the object is held against the palm or on one side only; are all digits \
                 pulled, and with the right signs?"
            )
        })
    }

    /// The report in words.
    pub fn text(&self) -> String {
        let share = |count: u64| format!("{count:5} ({:.1} %)", 100.0 * count as f64 / self.requested as f64);
        let mut rows = vec![
            format!(
                "{} on {}: {} chains, {:.1} s, {:.0} grasp-steps/s per thread, {} surface points, {} candidates",
                self.hand,
                self.object,
                self.requested,
                self.wall_s,
                self.grasp_steps_per_s,
                self.surface_points,
                self.candidates
            ),
            format!("closed            {}", share(self.found)),
            format!("  blocked         {}", share(self.blocked)),
            format!("  pushed away     {}", share(self.pushed_away)),
            format!("(a) cone program  {}", share(self.verified.a)),
            format!("(b) penetration   {}", share(self.verified.b)),
            format!("(c) held          {}", share(self.verified.c)),
        ];
        if let Some(Judgement { refused, .. }) = &self.judgement {
            rows.extend([
                format!("refused           {}", share(refused.all())),
                format!("  on a fixed part {}", share(refused.leans_on_fixed_part)),
                format!("  off the surface {}", share(refused.contact_off_surface)),
                format!("  out of reach    {}", share(refused.unreachable)),
            ]);
        }
        rows.extend([
            format!("all three         {}", share(self.verified.all)),
            format!("  at first closing{}; {} closings in all", share(self.plain), self.closings),
        ]);
        if let Some(Judgement { opposed, surface_gap, held_without_tension, .. }) = &self.judgement {
            rows.extend([
                format!("  of these with opposed digits {opposed}"),
                format!("  contacts within {:.1} mm of the links' own surfaces", 1e3 * surface_gap),
                format!("  of these held without tension {held_without_tension}"),
            ]);
        }
        rows.push(format!("kept              {:5}, without {} near duplicates", self.kept, self.duplicates));
        if !self.digits.is_empty() {
            let digits: Vec<String> = self.digits.iter().map(|(name, count)| format!("{name} {count}")).collect();
            rows.push(format!("digits            {}", digits.join(", ")));
        }
        rows.push(self.load.text());
        rows.into_iter().chain(self.opposition_warning()).map(|row| row + "\n").collect()
    }
}

/// Where a search begins: after an interrupted one, or from nothing.
#[derive(Debug, Default)]
pub struct Start {
    /// Number of the first chain.
    pub chain: u64,
    /// Grasps found before it.
    pub kept: Vec<HeldGrasp>,
}

/// Runs all chains; every verified grasp that is no near duplicate goes to `writer` when its batch is done. Answers with what
/// it came to and all grasps kept.
pub fn search(
    synthesizer: &Synthesizer<'_>,
    from: Start,
    mut writer: Option<GraspWriter>,
    progress: &ProgressBar,
) -> Result<(Report, Vec<HeldGrasp>)> {
    let start = Instant::now();
    let Synthesizer { hand, subject, request, .. } = synthesizer;
    let model = &subject.model;
    let surface = &hand.sampled.surface;
    let (candidates, surface_points) = (surface.candidates.len(), surface.len());
    let mut report = Report { object: model.name.clone(), candidates, surface_points, ..hand.report() };
    show_chains(progress, &model.name, request.chains)?;
    progress.set_position(from.chain);
    let (mut steps, mut sampling_s) = (0, 0.0);
    let mut kept = from.kept;
    for first in (from.chain..request.chains).step_by(BATCH as usize) {
        if kept.len() >= request.enough {
            break;
        }
        let chains = first..(first + BATCH).min(request.chains);
        let results: Vec<(u64, ChainResult)> =
            chains.into_par_iter().map(|chain| Ok((chain, synthesizer.run(chain)?))).collect::<Result<_>>()?;
        let before = kept.len();
        let mut fresh: Vec<&Checked> = Vec::new();
        for (chain, result) in &results {
            steps += result.steps;
            sampling_s += result.sampling_s;
            report.requested += 1;
            report.closings += result.closings as u64;
            progress.inc(1);
            report.plain += u64::from(result.plain.as_ref().is_ok_and(Checked::verified));
            let checked = match result.grasp() {
                Ok(checked) => checked,
                Err(NotClosed::Blocked) => {
                    report.blocked += 1;
                    continue;
                }
                Err(NotClosed::PushedAway) => {
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
            hand.count(checked, &mut report);
            let grasp = hand.record(subject, *chain, checked);
            if kept.iter().any(|other| other.nearly_equals(&grasp, |a, b| model.symmetry.angle(a, b))) {
                report.duplicates += 1;
            } else if kept.len() < request.enough {
                kept.push(grasp);
                fresh.push(checked);
            }
        }
        // A proof costs more than all that went before, so only what is kept gets one.
        kept[before..].par_iter_mut().zip(fresh).for_each(|(grasp, checked)| {
            let proof: Proof = synthesizer.proof(checked);
            hand.prove(checked, proof, grasp);
        });
        if let Some(writer) = &mut writer {
            for grasp in &kept[before..] {
                writer.add(&grasp.clone().with_frame_moved(&subject.origin).rounded())?;
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
    let payloads = kept.iter().filter_map(|grasp| Some(grasp.proof?.payload));
    report.load = Load::of(model, payloads);
    report.wall_s = start.elapsed().as_secs_f64();
    report.grasp_steps_per_s = steps as f64 / sampling_s.max(1e-9);
    report.notes.extend(report.opposition_warning());
    Ok((report, kept))
}

/// Makes `progress` that of a search of so many chains for an object.
fn show_chains(progress: &ProgressBar, object: &str, chains: u64) -> Result<()> {
    progress.set_length(chains);
    let template = format!("{object:16} {{bar:30}} {{pos}}/{{len}} chains, {{msg}} verified [{{elapsed}} < {{eta}}]");
    progress.set_style(ProgressStyle::with_template(&template)?);
    progress.set_message("0");
    Ok(())
}

/// Reads `--contacts`: `5` or `2-5`.
pub fn parse_contacts(text: &str) -> Result<(usize, usize)> {
    let most = grasping::synthesis::energy::MAX_CONTACTS;
    let (low, high) = text.split_once('-').unwrap_or((text, text));
    match (low.parse::<usize>(), high.parse::<usize>()) {
        (Ok(low), Ok(high)) if 2 <= low && low <= high && high <= most => Ok((low, high)),
        _ => anyhow::bail!("--contacts: found `{text}`, expected a number from 2 to {most} or a range such as 2-5"),
    }
}

/// Checks that a result file can be made before any work is done.
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
    use super::super::subject::Subject;
    use super::super::synthesizer::Request;
    use super::*;

    fn verified(threads: usize) -> (Verified, Vec<String>) {
        let request = Request { chains: 6, enough: usize::MAX, contacts: (5, 5), closings: 4, seed: 3, table: false };
        let hand = GraspingHand::of(Arc::new(Hand::ftac()));
        let synthesizer = Synthesizer::new(&hand, Subject::named("ball").expect("the ball"), request);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("held.jsonl");
        let header = grasping::synthesis::grasp_file::Header::new(String::new(), 3);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let writer = GraspWriter::create(&path, &header).expect("created");
        let (report, _) = pool
            .install(|| search(&synthesizer, Start::default(), Some(writer), &ProgressBar::hidden()))
            .expect("searched");
        let lines = std::fs::read_to_string(&path).expect("read").lines().map(str::to_owned).collect();
        (report.verified, lines)
    }

    /// Any number of threads finds the same grasps, to the last digit, in the same order.
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
