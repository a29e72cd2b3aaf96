//! Parts of the collection: one file of verified grasps per object, which grows while the search runs.
//!
//! An interrupted search resumes from its file. The grasps are the same either way, because a chain is determined by
//! its number and grasps are taken in the order of their chains. A search for more grasps resumes from one for fewer.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use dexterous_grasping::synthesis::collection::{Collection, ObjectGrasps, SearchSummary};
use dexterous_grasping::synthesis::diversity::{self, Diversity, Opposition};
use dexterous_grasping::synthesis::grasp_file::{GraspFileHeader, GraspWriter};
use dexterous_grasping::synthesis::held::HeldGrasp;
use hand_model::Hand;
use indicatif::ProgressBar;

use super::grasping_hand::GraspingHand;
use super::report::SynthesisReport;
use super::search::{self, SearchStart};
use super::subject::PreparedObject;
use super::synthesizer::{SynthesisRequest, Synthesizer};

/// Part of one object.
#[derive(Debug, Clone, Copy)]
pub struct CollectionPart<'a> {
    /// Name of the object.
    pub object: &'a str,
    /// File of its grasps.
    pub file: &'a Path,
    /// The file's header: the inputs that determine the object's grasps. The number of grasps wanted is not among them.
    pub header: &'a GraspFileHeader,
}

impl CollectionPart<'_> {
    /// Continues the search until `request` is met, and returns the object's grasps.
    pub fn fill(&self, hand: &Arc<Hand>, request: SynthesisRequest, progress: &ProgressBar) -> Result<ObjectGrasps> {
        let (writer, kept) = self.open()?;
        let chain = kept.last().map_or(0, |grasp| grasp.chain + 1);
        let (report, grasps) = if kept.len() < request.max_grasps {
            let hand = GraspingHand::from_hand(hand.clone());
            let synthesizer = Synthesizer::new(&hand, PreparedObject::from_set(self.object)?, request);
            search::search(&synthesizer, SearchStart { chain, kept }, Some(writer), progress)?
        } else {
            (SynthesisReport::default(), kept.into_iter().take(request.max_grasps).collect())
        };
        let full = grasps.len() >= request.max_grasps;
        let chains = if full { chains_behind(&grasps) } else { request.chains };
        let short = (!full).then(|| {
            format!(
                "{} chains from number {chain} on: {} blocked, {} pushed away, {} closed but not verified, {} near duplicates",
                report.requested,
                report.blocked,
                report.pushed_away,
                report.found - report.verified.all,
                report.duplicates
            )
        });
        Ok(self.grasps(request.max_grasps, grasps, chains, short))
    }

    /// Returns the object's grasps found so far, at most `wanted`.
    pub fn found_so_far(&self, wanted: usize) -> Result<ObjectGrasps> {
        if !self.file.exists() {
            return Ok(self.grasps(wanted, Vec::new(), 0, Some("not searched yet".into())));
        }
        let (_, mut grasps) = self.open()?;
        grasps.truncate(wanted);
        let short = (grasps.len() < wanted).then(|| "the search is not finished".to_owned());
        let chains = chains_behind(&grasps);
        Ok(self.grasps(wanted, grasps, chains, short))
    }

    fn open(&self) -> Result<(GraspWriter, Vec<HeldGrasp>)> {
        Ok(if self.file.exists() {
            GraspWriter::resume(self.file, self.header)?
        } else {
            (GraspWriter::create(self.file, self.header)?, Vec::new())
        })
    }

    fn grasps(&self, wanted: usize, grasps: Vec<HeldGrasp>, chains: u64, short: Option<String>) -> ObjectGrasps {
        let summary =
            SearchSummary { object: self.object.into(), requested: wanted, kept: grasps.len(), chains, short };
        ObjectGrasps { summary, grasps }
    }
}

/// Returns the number of chains that it took to find `grasps`.
fn chains_behind(grasps: &[HeldGrasp]) -> u64 {
    grasps.last().map_or(0, |grasp| grasp.chain + 1)
}

/// Formats one line per object and one for all: number of grasps, number of chains, and diversity.
pub fn table(collection: &Collection) -> String {
    let mut text = format!(
        "{:16} {:>6} {:>6} {:>4}  {:>4} {:>4} {:>4} {:>4} {:>4} {:>4}  {:>4} {:>4} {:>4} {:>4}  {:>6} {:>4} {:>4} {:>4}\n",
        "%",
        "grasps",
        "chains",
        "sets",
        "T",
        "I",
        "M",
        "R",
        "L",
        "palm",
        "pad",
        "palm",
        "side",
        "fing",
        "abduct",
        "PC1",
        "PC3",
        "PC6"
    );
    for entry in &collection.objects {
        text += &row(&entry.summary.object, entry.summary.chains, &diversity::describe(&entry.grasps));
    }
    let chains = collection.objects.iter().map(|entry| entry.summary.chains).sum();
    text + &row("all", chains, &diversity::describe(collection.grasps()))
}

fn row(name: &str, chains: u64, d: &Diversity) -> String {
    let percent = |share: f64| format!("{:4.0}", 100.0 * share);
    let [pad, palm, side, fingers] = Opposition::ALL.map(|kind| percent(d.opposition_share(kind)));
    let explained = |n: usize| d.explained.get(n - 1).map_or("   -".into(), |share| percent(*share));
    let digits: Vec<String> = d.digits.iter().map(|share| percent(*share)).collect();
    format!(
        "{name:16} {:6} {chains:6} {:4}  {} {}  {} {} {} {}  {:>6} {} {} {}\n",
        d.grasps,
        d.sets.len(),
        digits.join(" "),
        percent(d.palm),
        pad,
        palm,
        side,
        fingers,
        percent(d.thumb[2]),
        explained(1),
        explained(3),
        explained(6)
    )
}
