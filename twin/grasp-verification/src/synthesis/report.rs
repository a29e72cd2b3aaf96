//! Results of a search for grasps, as numbers and as text.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::object_properties::ObjectProperties;
use super::urdf_hand::refusal::RefusalCounts;

/// Counts of passed checks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct CheckCounts {
    /// Passed (a), the friction-cone margin.
    pub a: u64,
    /// Passed (b), penetration.
    pub b: u64,
    /// Passed (c), held against the six forces.
    pub c: u64,
    /// Passed all three.
    pub all: u64,
}

impl CheckCounts {
    /// Counts one more grasp with these verdicts.
    pub fn add(&mut self, [a, b, c]: [bool; 3]) {
        self.a += u64::from(a);
        self.b += u64::from(b);
        self.c += u64::from(c);
        self.all += u64::from(a && b && c);
    }
}

/// Results for a hand whose surface and palm are derived from its files.
#[derive(Debug, Clone, Default, Serialize, JsonSchema)]
pub struct DerivedHandCounts {
    /// Grasps that passed all three checks but are refused.
    pub refused: RefusalCounts,
    /// Verified grasps in which two digits press against each other.
    pub opposed: u64,
    /// Largest distance of a verified grasp's contact from its link's own surface, m. In the record, the contact is
    /// moved onto that surface.
    pub surface_gap: f64,
    /// Number of verified grasps that still held without tension, which has to be small.
    pub held_without_tension: u64,
}

/// Results of a search.
#[derive(Debug, Clone, Default, Serialize, JsonSchema)]
pub struct SynthesisReport {
    pub hand: String,
    pub object: String,
    /// Number of contact candidates on the hand.
    pub candidates: usize,
    /// Number of points on the hand's surface.
    pub surface_points: usize,
    /// Number of chains run.
    pub requested: u64,
    /// Number of chains that ended in a closed grasp.
    pub found: u64,
    /// Number of chains whose posture could not be opened clear of the object.
    pub blocked: u64,
    /// Number of chains whose closing digits pushed the object away.
    pub pushed_away: u64,
    /// Number of closings tried in all.
    pub closings: u64,
    /// Number of chains whose first, plain closing passed all checks.
    pub plain: u64,
    /// Counts of checks passed. All three counts only grasps that are not refused.
    pub verified: CheckCounts,
    /// Number of verified grasps of the wanted type. `None` if any type will do.
    pub of_type: Option<u64>,
    /// Number of verified grasps that nearly equal an earlier one. They are not written.
    pub duplicates: u64,
    /// Number of grasps kept and written.
    pub kept: usize,
    #[serde(flatten)]
    pub judgement: Option<DerivedHandCounts>,
    /// Mass (kg) and friction for which grasps are verified, and the payloads of those kept.
    pub load: ObjectProperties,
    /// Wall time, s.
    pub wall_s: f64,
    /// Iterations of the sampler per second and thread.
    pub grasp_steps_per_s: f64,
    /// Number of verified grasps by digit used. Empty for a hand whose digits have no names.
    pub digits: BTreeMap<&'static str, u64>,
    /// Findings about the hand, as text. Warnings begin with `WARNING`.
    pub notes: Vec<String>,
}

impl SynthesisReport {
    /// Returns a warning if the hand holds objects, but never between digits that oppose each other.
    pub(super) fn opposition_warning(&self) -> Option<String> {
        let all = self.verified.all;
        let alike = all > 0 && self.judgement.as_ref().is_some_and(|judgement| judgement.opposed == 0);
        alike.then(|| {
            format!(
                "WARNING none of the {all} grasps uses opposed digits: the object is held against the palm or on one side only; are all digits \
                 pulled, and with the right signs?"
            )
        })
    }

    /// Formats the report as text.
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
        if let Some(DerivedHandCounts { refused, .. }) = &self.judgement {
            rows.extend([
                format!("refused           {}", share(refused.total())),
                format!("  on a fixed part {}", share(refused.leans_on_fixed_part)),
                format!("  off the surface {}", share(refused.contact_off_surface)),
                format!("  out of reach    {}", share(refused.unreachable)),
            ]);
        }
        rows.extend([
            format!("all three         {}", share(self.verified.all)),
            format!("  at first closing{}; {} closings in all", share(self.plain), self.closings),
        ]);
        if let Some(DerivedHandCounts { opposed, surface_gap, held_without_tension, .. }) = &self.judgement {
            rows.extend([
                format!("  of these with opposed digits {opposed}"),
                format!("  contacts within {:.1} mm of the links' own surfaces", 1e3 * surface_gap),
                format!("  of these held without tension {held_without_tension}"),
            ]);
        }
        if let Some(of_type) = self.of_type {
            rows.push(format!("of the type       {}", share(of_type)));
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
