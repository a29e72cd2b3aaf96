//! The hand as the synthesis of grasps needs it: the built-in one of cables, or one from a URDF.

use anyhow::Result;
use grasping::synthesis::energy::Plane;
use grasping::synthesis::frames::{Frames, HandState};
use grasping::synthesis::held::{HeldGrasp, Proof};
use grasping::synthesis::mechanism::Mechanism;
use grasping::synthesis::posture::FreePosture;
use grasping::synthesis::surface::HandSurface;
use hand_model::kinematics::Tree;
use nalgebra::Isometry3;
use sim::hand_scene::HandScene;

use super::closing::Closed;
use super::hands::BestGrasp;
use super::search::Report;
use super::size::Opening;
use super::subject::Subject;
use super::synthesizer::Checked;
use super::urdf_hand::refusal::Refusal;

/// A hand as it is sampled, in the palm frame: the object comes along -z.
pub struct SampledHand {
    pub tree: Tree,
    /// Joint limits and actuator lines.
    pub mechanism: Mechanism,
    /// Points, contact candidates, pairs of links that may collide.
    pub surface: HandSurface,
}

/// A hand for which grasps are synthesized.
pub trait GraspingHand: Send + Sync {
    /// Range from which an actuator's tension is drawn, N.
    const TENSIONS: (f64, f64);

    fn sampled(&self) -> &SampledHand;

    /// The widest that it takes.
    fn opening(&self) -> Opening;

    /// For each actuator, true if it closes a sample with these contact candidates.
    fn closing(&self, contacts: &[usize]) -> Vec<bool>;

    /// The nearest posture that the actuators hold clear of the object, and `root_from_object` there; none if the hand is not cleared.
    fn open_clear(
        &self,
        subject: &Subject,
        frames: &mut Frames,
        sample: &HandState,
    ) -> Option<(Isometry3<f64>, FreePosture)>;

    /// `tensions` (N) as far as the joints bear them.
    fn bearable(&self, tensions: Vec<f64>) -> Vec<f64> {
        tensions
    }

    /// The hand with its joints at `joints` (rad or m) and the floating object at `start` (`root_from_object`).
    fn scene(&self, subject: &Subject, start: &Isometry3<f64>, joints: &[f64]) -> HandScene;

    /// Wrench margin of a closed grasp, N.
    fn margin(&self, subject: &Subject, closed: &Closed) -> Result<f64>;

    /// Deepest penetration in a closed grasp, m.
    fn penetration(&self, subject: &Subject, closed: &Closed) -> f64;

    /// Reason to refuse a closed grasp that passed all checks.
    fn refusal(&self, _subject: &Subject, _closed: &Closed, _table: Option<&Plane>) -> Option<Refusal> {
        None
    }

    /// An empty report of a search.
    fn report(&self) -> Report;

    /// Counts a verified grasp in the report.
    fn count(&self, checked: &Checked, report: &mut Report);

    /// The record of a verified grasp but for its proof.
    fn record(&self, subject: &Subject, chain: u64, checked: &Checked) -> HeldGrasp;

    /// Completes a record.
    fn prove(&self, checked: &Checked, proof: Proof, grasp: &mut HeldGrasp);

    /// The open posture of a record, and the tensions (N) that close it.
    fn reopened(&self, grasp: &HeldGrasp) -> (FreePosture, Vec<f64>);

    /// A record in the palm frame.
    fn in_palm_frame(&self, grasp: &HeldGrasp) -> BestGrasp;
}
