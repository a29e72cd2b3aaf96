//! One chain of the search, from its random start to a checked grasp.

use std::time::Instant;

use anyhow::{Context, Result};
use dexterous_grasping::synthesis::chain::{self, AnnealingSchedule, GraspSample};
use dexterous_grasping::synthesis::energy::{EnergyWeights, GraspEnergy, TablePlane};
use dexterous_grasping::synthesis::frames::LinkFrames;
use dexterous_grasping::synthesis::held::{HeldGrasp, VerifiedLoad};
use nalgebra::{Unit, Vector3};
use world::objects::ObjectModel;

use super::checks::{self, HoldTestResult};
use super::closing::{self, ClosedGrasp, ClosingFailure, ClosingParameters};
use super::grasping_hand::GraspingHand;
use super::record;
use super::subject::PreparedObject;
use super::type_filter::GraspTypeFilter;
use super::urdf_hand::refusal::{self, RefusalReason};

/// Parameters of a search.
#[derive(Debug, Clone, Copy)]
pub struct SynthesisRequest {
    /// Maximum number of chains; each may leave one grasp.
    pub chains: u64,
    /// Number of grasps that is enough. The search stops after the batch of chains that reaches it, and keeps no more.
    pub max_grasps: usize,
    /// Contact points of a chain, (fewest, most). The chains take the numbers of this range in turn.
    pub contacts: (usize, usize),
    /// Closings tried on a chain's sample, at least 1.
    pub closings: usize,
    /// Seed of all chains.
    pub seed: u64,
    /// True if the object rests on a table, which the hand keeps out of.
    pub table: bool,
}

impl SynthesisRequest {
    /// Returns the number of contact points of chain number `chain`.
    pub fn contacts_of(&self, chain: u64) -> usize {
        let (fewest, most) = self.contacts;
        fewest + (chain as usize) % (most - fewest + 1)
    }
}

/// Data that all chains share.
pub struct Synthesizer<'a> {
    pub hand: &'a GraspingHand,
    /// The object.
    pub subject: PreparedObject,
    /// Parameters of the search.
    pub request: SynthesisRequest,
    /// Type of grasp that is searched for. Verified grasps of other types are not kept; `None` keeps all.
    pub type_filter: Option<GraspTypeFilter>,
    schedule: AnnealingSchedule,
}

/// A closed grasp with the results of its checks.
pub struct CheckedGrasp {
    /// The sample it came from.
    pub sample: GraspSample,
    /// The closed grasp.
    pub closed: ClosedGrasp,
    /// Wrench margin, N.
    pub margin: f64,
    /// Deepest penetration, m.
    pub penetration: f64,
    /// Result of the holding test.
    pub hold: HoldTestResult,
    /// Mass of the object in the holding test, kg.
    pub mass: f64,
    /// Reason to refuse the grasp although it passed all checks.
    pub refusal: Option<RefusalReason>,
}

impl CheckedGrasp {
    /// Returns the verdicts of the checks (a) wrench margin, (b) penetration and (c) holding test.
    pub fn verdicts(&self) -> [bool; 3] {
        let margin = self.margin >= checks::MIN_MARGIN;
        [margin, self.penetration <= checks::MAX_PENETRATION, self.hold.held]
    }

    /// True if the grasp passed all three checks and is not refused.
    pub fn verified(&self) -> bool {
        self.verdicts() == [true; 3] && self.refusal.is_none()
    }
}

/// Result of a chain.
pub struct ChainResult {
    /// Iterations of the sampler.
    pub steps: usize,
    /// Time that the chain's thread spent in the sampler, s.
    pub sampling_s: f64,
    /// Result of the plain closing: the closed grasp with all checks, or the reason why there is none. Nothing is
    /// selected here.
    pub plain: Result<CheckedGrasp, ClosingFailure>,
    /// Result of the further closings, which are tried only if the plain one is not verified and of the wanted type. It
    /// is the first that is, or else the last that holds.
    pub other: Option<CheckedGrasp>,
    /// Number of closings tried.
    pub closings: usize,
}

impl ChainResult {
    /// Returns the chain's grasp: the verified one if there is one.
    pub fn grasp(&self) -> Result<&CheckedGrasp, ClosingFailure> {
        match (&self.other, &self.plain) {
            (Some(other), _) => Ok(other),
            (None, Ok(plain)) => Ok(plain),
            (None, Err(reason)) => Err(*reason),
        }
    }
}

/// Returns the table on which an object rests, object frame.
pub fn table(model: &ObjectModel) -> TablePlane {
    let up = model.rest.inverse() * Vector3::z();
    TablePlane { normal: Unit::new_normalize(up), offset: -model.rest_height() }
}

impl<'a> Synthesizer<'a> {
    /// Creates a synthesizer for a hand and one object.
    pub fn new(hand: &'a GraspingHand, subject: PreparedObject, request: SynthesisRequest) -> Self {
        Self { hand, subject, request, type_filter: None, schedule: AnnealingSchedule::default() }
    }

    fn table(&self) -> Option<TablePlane> {
        self.request.table.then(|| table(&self.subject.model))
    }

    /// Runs chain number `chain`, closes its best sample and checks it.
    pub fn run(&self, chain: u64) -> Result<ChainResult> {
        let (hand, sampled, field) = (self.hand, &self.hand.sampled, &self.subject.field);
        let mut energy = GraspEnergy::from_mechanism(
            sampled.mechanism.clone(),
            &sampled.surface,
            field,
            EnergyWeights::default(),
            self.table(),
        );
        energy.start_points = &self.subject.start_points;
        let mut frames = LinkFrames::new(&sampled.tree);
        let mut rng = chain::chain_rng(self.request.seed, chain);
        let start = Instant::now();
        let end = chain::run(&energy, &mut frames, self.request.contacts_of(chain), &self.schedule, &mut rng);
        let sampling_s = start.elapsed().as_secs_f64();
        let closing = hand.closing(&end.best.contacts);
        let mut close = |aim: &ClosingParameters| closing::close(hand, &self.subject, &end.best, &mut frames, aim);
        let plain = match close(&ClosingParameters::plain(&closing, hand.tensions)) {
            Err(reason) => Err(reason),
            Ok(closed) => {
                let measured = self.measure(&closed).with_context(|| format!("chain {chain}"))?;
                Ok(self.check(&end.best, closed, measured))
            }
        };
        let (mut other, mut closings) = (None, 1);
        let good = |checked: &CheckedGrasp| self.is_accepted(chain, checked);
        if !plain.as_ref().is_ok_and(good) {
            while closings < self.request.closings && !other.as_ref().is_some_and(good) {
                closings += 1;
                let Ok(closed) = close(&ClosingParameters::varied(&closing, &hand.may_close, hand.tensions, &mut rng))
                else {
                    continue;
                };
                let (margin, penetration) = self.measure(&closed).with_context(|| format!("chain {chain}"))?;
                if margin < checks::MIN_MARGIN || penetration > checks::MAX_PENETRATION {
                    continue;
                }
                let checked = self.check(&end.best, closed, (margin, penetration));
                if checked.hold.held {
                    other = Some(checked);
                }
            }
        }
        Ok(ChainResult { steps: end.steps, sampling_s, plain, other, closings })
    }

    /// Returns the wrench margin (N) and the penetration (m) of a closed grasp.
    fn measure(&self, closed: &ClosedGrasp) -> Result<(f64, f64)> {
        let margin = checks::margin(self.hand, &self.subject, closed)?;
        Ok((margin, checks::penetration(self.hand, &self.subject, closed)))
    }

    /// Runs the remaining checks of a closed grasp.
    fn check(&self, sample: &GraspSample, closed: ClosedGrasp, (margin, penetration): (f64, f64)) -> CheckedGrasp {
        let mass = self.subject.model.mass;
        let hold = checks::run_hold_test(&closed, mass);
        let mut checked =
            CheckedGrasp { sample: sample.clone(), closed, margin, penetration, hold, mass, refusal: None };
        if checked.verified() {
            let table = self.table();
            let refused =
                |found| refusal::reason_to_refuse(self.hand, found, &self.subject, &checked.closed, table.as_ref());
            checked.refusal = self.hand.derived_surface.as_ref().and_then(refused);
        }
        checked
    }

    /// True if the grasp is verified and of the wanted type.
    fn is_accepted(&self, chain: u64, checked: &CheckedGrasp) -> bool {
        checked.verified()
            && self.is_of_wanted_type(|| record::to_held_grasp(self.hand, &self.subject, chain, checked)) != Some(false)
    }

    /// Returns true if a verified grasp is of the wanted type, and `None` if any type will do.
    pub fn is_of_wanted_type(&self, grasp: impl FnOnce() -> HeldGrasp) -> Option<bool> {
        let (wanted, named) = (self.type_filter.as_ref()?, self.hand.named_hand.as_ref()?);
        Some(wanted.matches(named, &grasp()))
    }

    /// Returns the verified load of a grasp: the mass, friction and payload for which it holds.
    pub fn verified_load(&self, checked: &CheckedGrasp) -> VerifiedLoad {
        let payload = checks::payload(&checked.closed, checked.mass, &checked.hold);
        VerifiedLoad { mass: checked.mass, friction: self.subject.model.friction, payload }
    }
}
