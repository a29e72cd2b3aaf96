//! Comparison of hands on the same objects, by the same search and the same checks.
//!
//! A cell is one hand on one object. It is kept in a file of its own, so that an interrupted comparison resumes after
//! the last cell.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use dexterous_grasping::synthesis::held::{HeldGrasp, pose_from_array, pose_to_array};
use ftac_platform::file::write_atomically;
use hand_model::Hand;
use indicatif::ProgressBar;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::SuccessRate;

use super::grasp_file::source_file;
use super::grasping_hand::GraspingHand;
use super::report::CheckCounts;
use super::search::{self, SearchStart};
use super::subject::PreparedObject;
use super::synthesizer::{SynthesisRequest, Synthesizer};
use super::urdf_hand::describe;

/// A hand of the comparison.
pub struct ComparedHand {
    pub hand: GraspingHand,
    /// SHA-256 of its files. Empty for our own hand.
    files: String,
}

impl ComparedHand {
    /// Creates the entry of our own hand.
    pub fn from_hand(hand: Arc<Hand>) -> Self {
        Self { hand: GraspingHand::from_hand(hand), files: String::new() }
    }

    pub fn read(urdf: &Path, pulls: &Path) -> Result<Self> {
        let files = format!("{} {}", source_file(urdf)?.sha256, source_file(pulls)?.sha256);
        Ok(Self { hand: describe::read(urdf, pulls)?, files })
    }
}

/// Inputs that determine the result of a cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CellInputs {
    /// Name of the hand.
    pub hand: String,
    /// Name of the object.
    pub object: String,
    /// Number of chains.
    pub chains: u64,
    contacts: (usize, usize),
    closings: usize,
    seed: u64,
    /// Mass (kg) and friction of the object.
    mass: f64,
    friction: f64,
    /// SHA-256 of the hand's files.
    files: String,
}

/// A grasp that held, for a figure. Palm frame, m and rad.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BestGrasp {
    /// x, y, z, then i, j, k, w.
    pub palm_from_object: [f64; 7],
    /// Joint angles in the order of the hand's tree.
    pub joints: Vec<f64>,
    /// Contact points.
    pub contacts: Vec<[f64; 3]>,
    /// Wrench margin, N.
    pub margin: f64,
}

/// One hand on one object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ComparisonCell {
    /// Inputs of the cell.
    #[serde(alias = "asked")]
    pub inputs: CellInputs,
    /// Number of chains that ended in a closed grasp.
    closed: u64,
    /// Counts of checks passed.
    verified: CheckCounts,
    /// Number of verified grasps that held without tension. Not tried for our own hand.
    held_without_tension: Option<u64>,
    /// The verified grasp with the largest wrench margin.
    pub best: Option<BestGrasp>,
}

impl ComparisonCell {
    /// Reads the cell that an earlier run left in `folder`, or computes it and writes it there.
    pub fn resume(hand: &ComparedHand, object: &str, request: &SynthesisRequest, folder: &Path) -> Result<Self> {
        let subject = PreparedObject::from_set(object)?;
        let asked = CellInputs {
            hand: hand.hand.name().into(),
            object: object.into(),
            chains: request.chains,
            contacts: request.contacts,
            closings: request.closings,
            seed: request.seed,
            mass: subject.model.mass,
            friction: subject.model.friction,
            files: hand.files.clone(),
        };
        let plain = |name: &str| name.replace(|c: char| !c.is_ascii_alphanumeric(), "_");
        let path = folder.join(format!("{}-{}.json", plain(&asked.hand), plain(&asked.object)));
        match std::fs::read_to_string(&path) {
            Ok(text) => {
                let known: Self = serde_json::from_str(&text)
                    .with_context(|| format!("{}: not a cell of this version; take another --out", path.display()))?;
                let (found, expected) = (&known.inputs, &asked);
                ensure!(
                    found == expected,
                    "{}: asked: found {found:?}, expected {expected:?}; take another --out",
                    path.display()
                );
                return Ok(known);
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => return Err(error).with_context(|| path.display().to_string()),
        }
        let made = compute_cell(&hand.hand, subject, asked, request)?;
        write_atomically(&path, serde_json::to_string(&made)?.as_bytes())
            .with_context(|| format!("cannot write {}", path.display()))?;
        Ok(made)
    }

    /// Returns the share of the chains that left a verified grasp.
    pub fn rate(&self) -> SuccessRate {
        SuccessRate::new(self.verified.all, self.inputs.chains)
    }
}

fn compute_cell(
    hand: &GraspingHand,
    subject: PreparedObject,
    asked: CellInputs,
    request: &SynthesisRequest,
) -> Result<ComparisonCell> {
    let synthesizer = Synthesizer::new(hand, subject, *request);
    let (report, held) = search::search(&synthesizer, SearchStart::default(), None, &ProgressBar::hidden())?;
    let best = held.iter().max_by(|a, b| a.margin.total_cmp(&b.margin)).map(|grasp| in_palm_frame(hand, grasp));
    let slack = report.judgement.map(|judgement| judgement.held_without_tension);
    Ok(ComparisonCell {
        inputs: asked,
        closed: report.found,
        verified: report.verified,
        held_without_tension: slack,
        best,
    })
}

/// Converts a record to the palm frame.
fn in_palm_frame(hand: &GraspingHand, grasp: &HeldGrasp) -> BestGrasp {
    let point = |point: &[f64; 3]| (hand.palm_from_root * Point3::from(*point)).coords.into();
    BestGrasp {
        palm_from_object: pose_to_array(&(hand.palm_from_root * pose_from_array(&grasp.closed))),
        joints: grasp.joints.to_vec(),
        contacts: grasp.contacts.iter().map(|contact| point(&contact.point)).collect(),
        margin: grasp.margin,
    }
}

/// Returns the rate of a hand over all of its cells together.
pub fn total(cells: &[ComparisonCell], hand: &str) -> SuccessRate {
    let own = cells.iter().filter(|cell| cell.inputs.hand == hand);
    let (count, of) = own.fold((0, 0), |(count, of), cell| (count + cell.verified.all, of + cell.inputs.chains));
    SuccessRate::new(count, of)
}

/// One hand on one object.
#[derive(Debug, Serialize, JsonSchema)]
struct ComparisonRow {
    /// Name of the hand.
    hand: String,
    /// Name of the object.
    object: String,
    /// Number of chains whose grasp passes (a) the cone program, (b) penetration and (c) the holding test, and is not
    /// refused.
    verified: u64,
    /// Number of chains run.
    chains: u64,
    /// Lower end of the 95 % interval.
    low: f64,
    /// Upper end of the 95 % interval.
    high: f64,
    /// Number of chains that ended in a closed grasp.
    closed: u64,
    /// Number of chains that pass each check.
    checks: CheckCounts,
    /// Number of verified grasps that hold without tension, which should be small. Null for our own hand.
    held_without_tension: Option<u64>,
}

/// Cells and the total of each hand, as written to `hands.json`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct HandComparison {
    /// One entry per hand and object.
    rows: Vec<ComparisonRow>,
    /// Rates by hand.
    hands: BTreeMap<String, SuccessRate>,
}

impl HandComparison {
    pub fn from_cells(cells: &[ComparisonCell]) -> Self {
        let row = |cell: &ComparisonCell| {
            let SuccessRate { count, of, low, high, .. } = cell.rate();
            ComparisonRow {
                hand: cell.inputs.hand.clone(),
                object: cell.inputs.object.clone(),
                verified: count,
                chains: of,
                low,
                high,
                closed: cell.closed,
                checks: cell.verified,
                held_without_tension: cell.held_without_tension,
            }
        };
        let hands = cells.iter().map(|cell| (cell.inputs.hand.clone(), total(cells, &cell.inputs.hand)));
        Self { rows: cells.iter().map(row).collect(), hands: hands.collect() }
    }
}

/// Formats the comparison as a table, with a line per object and a column per hand. `cells` are in the order of
/// `hands`.
pub fn table(hands: &[ComparedHand], objects: &[String], cells: &[ComparisonCell]) -> String {
    let percent = |rate: &SuccessRate| {
        let (low, high) = (100.0 * rate.low, 100.0 * rate.high);
        format!("{}/{} [{low:.0}, {high:.0}] %", rate.count, rate.of)
    };
    let widths: Vec<usize> = hands.iter().map(|hand| hand.hand.name().len().max(18)).collect();
    let line = |first: &str, words: &[String]| {
        let rest: String = words.iter().zip(&widths).map(|(word, width)| format!("  {word:>width$}")).collect();
        format!("{first:14}{rest}\n")
    };
    let mut text = "grasps that pass all three checks, of chains, with Wilson 95 % intervals\n".to_owned();
    text += &line("object", &hands.iter().map(|hand| hand.hand.name().to_owned()).collect::<Vec<_>>());
    for object in objects {
        let own = cells.iter().filter(|cell| cell.inputs.object == *object);
        text += &line(object, &own.map(|cell| percent(&cell.rate())).collect::<Vec<_>>());
    }
    text + &line("all", &hands.iter().map(|hand| percent(&total(cells, hand.hand.name()))).collect::<Vec<_>>())
}
