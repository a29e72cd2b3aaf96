//! A chain from its random start to a checked grasp.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use grasping::synthesis::chain::{self, Sample, Schedule};
use grasping::synthesis::energy::{GraspEnergy, Plane, Weights};
use grasping::synthesis::frames::Frames;
use grasping::synthesis::held::{HeldContact, HeldGrasp, Proof, pose_to_array};
use grasping::synthesis::surface::HandSurface;
use hand_model::{Digit, Hand};
use nalgebra::{Point3, Unit, Vector3};
use world::objects::ObjectModel;

use super::checks::{self, Hold};
use super::closing::{self, Aim, Closed, NotClosed};
use super::subject::Subject;

/// Points on the hand's surface.
pub const SURFACE_POINTS: usize = 2000;

/// What to search for.
#[derive(Debug, Clone, Copy)]
pub struct Request {
    /// Chains at most, each of which may leave one grasp.
    pub chains: u64,
    /// Enough grasps: the search stops after the batch of chains that reaches it, and keeps no more.
    pub enough: usize,
    /// Contact points of a chain: this many at least and at most, taken in turn.
    pub contacts: (usize, usize),
    /// Closings tried on a chain's sample, at least 1.
    pub closings: usize,
    /// Seed of all chains.
    pub seed: u64,
    /// Whether the object rests on a table, which the hand keeps out of.
    pub table: bool,
}

impl Request {
    /// Contact points of chain number `chain`.
    pub fn contacts_of(&self, chain: u64) -> usize {
        let (fewest, most) = self.contacts;
        fewest + (chain as usize) % (most - fewest + 1)
    }
}

/// Everything that chains share.
pub struct Synthesizer {
    pub hand: Arc<Hand>,
    pub surface: HandSurface,
    /// The object.
    pub subject: Subject,
    /// What is searched for.
    pub request: Request,
    schedule: Schedule,
}

/// A closed grasp with what the checks found.
pub struct Checked {
    /// The sample it came from.
    pub sample: Sample,
    /// The closed grasp.
    pub closed: Closed,
    /// N.
    pub margin: f64,
    /// m.
    pub penetration: f64,
    /// The holding test.
    pub hold: Hold,
    /// Mass of the object in the holding test, kg.
    pub mass: f64,
}

impl Checked {
    /// Verdicts (a), (b), (c).
    pub fn verdicts(&self) -> [bool; 3] {
        let margin = self.margin >= checks::LEAST_MARGIN;
        [margin, self.penetration <= checks::MOST_PENETRATION, self.hold.held]
    }

    /// Whether it passed all three.
    pub fn verified(&self) -> bool {
        self.verdicts() == [true; 3]
    }
}

/// How a chain ended.
pub struct ChainResult {
    /// Iterations of the sampler.
    pub steps: usize,
    /// Seconds of its thread in the sampler.
    pub sampling_s: f64,
    /// What came of the plain closing: the closed grasp with all checks, or why there is none. Nothing is selected here.
    pub plain: Result<Checked, NotClosed>,
    /// The first of the other closings that passed all checks, where the plain one did not.
    pub other: Option<Checked>,
    /// Closings tried.
    pub closings: usize,
}

impl ChainResult {
    /// The chain's grasp: the verified one if there is one.
    pub fn grasp(&self) -> Result<&Checked, NotClosed> {
        match (&self.other, &self.plain) {
            (Some(other), _) => Ok(other),
            (None, Ok(plain)) => Ok(plain),
            (None, Err(reason)) => Err(*reason),
        }
    }
}

/// The table on which an object rests, object frame.
pub fn table(model: &ObjectModel) -> Plane {
    let up = model.rest.inverse() * Vector3::z();
    Plane { normal: Unit::new_normalize(up), offset: -model.rest_height() }
}

impl Synthesizer {
    /// For a hand and one object.
    pub fn new(hand: Arc<Hand>, subject: Subject, request: Request) -> Self {
        let surface = HandSurface::new(&hand, SURFACE_POINTS);
        Self { hand, surface, subject, request, schedule: Schedule::default() }
    }

    fn table(&self) -> Option<Plane> {
        self.request.table.then(|| table(&self.subject.model))
    }

    /// Runs chain number `chain`, closes its best sample and checks it.
    pub fn run(&self, chain: u64) -> Result<ChainResult> {
        let mut energy =
            GraspEnergy::new(&self.hand, &self.surface, &self.subject.field, Weights::default(), self.table());
        energy.places = &self.subject.places;
        let mut frames = Frames::new(&self.hand.tree);
        let mut rng = chain::stream(self.request.seed, chain);
        let start = Instant::now();
        let end = chain::run(&energy, &mut frames, self.request.contacts_of(chain), &self.schedule, &mut rng);
        let sampling_s = start.elapsed().as_secs_f64();
        let mass = self.subject.model.mass;
        let used = closing::digits(&self.surface, &end.best.contacts);
        let mut close =
            |aim: &Aim| closing::close(&self.hand, &self.surface, &self.subject, &end.best, &mut frames, aim);
        let plain = match close(&Aim::plain(&used)) {
            Err(reason) => Err(reason),
            Ok(closed) => {
                let (margin, penetration) = self.measure(&closed).with_context(|| format!("chain {chain}"))?;
                let hold = checks::hold(&closed, mass);
                Ok(Checked { sample: end.best.clone(), closed, margin, penetration, hold, mass })
            }
        };
        let (mut other, mut closings) = (None, 1);
        if !plain.as_ref().is_ok_and(Checked::verified) {
            while closings < self.request.closings && other.is_none() {
                closings += 1;
                let Ok(closed) = close(&Aim::varied(&used, &mut rng)) else { continue };
                let (margin, penetration) = self.measure(&closed).with_context(|| format!("chain {chain}"))?;
                if margin < checks::LEAST_MARGIN || penetration > checks::MOST_PENETRATION {
                    continue;
                }
                let hold = checks::hold(&closed, mass);
                let checked = Checked { sample: end.best.clone(), closed, margin, penetration, hold, mass };
                other = checked.verified().then_some(checked);
            }
        }
        Ok(ChainResult { steps: end.steps, sampling_s, plain, other, closings })
    }

    /// Wrench margin (N) and penetration (m) of a closed grasp.
    fn measure(&self, closed: &Closed) -> Result<(f64, f64)> {
        let margin = checks::margin(&self.subject, closed)?;
        Ok((margin, checks::penetration(&self.hand, &self.surface, &self.subject, closed)))
    }

    /// What a verified grasp is good for.
    pub fn proof(&self, checked: &Checked) -> Proof {
        let payload = checks::payload(&checked.closed, checked.mass, &checked.hold);
        Proof { mass: checked.mass, friction: self.subject.model.friction, payload }
    }

    /// The verified grasp as it is kept, without its [`Self::proof`].
    pub fn held(&self, chain: u64, checked: &Checked) -> HeldGrasp {
        let closed = &checked.closed;
        let palm_from_object = closed.scene.object();
        let touching = |digit: &Digit| {
            closed.touches.iter().any(|touch| touch.link.is_some_and(|link| self.hand.links(*digit).contains(&link)))
        };
        let (digits, free): (Vec<Digit>, Vec<Digit>) = self.hand.digits().iter().copied().partition(touching);
        let facing = palm_from_object.inverse_transform_vector(&-Vector3::z());
        let contacts = closed.touches.iter().map(|touch| HeldContact {
            link: touch.link,
            point: touch.point.coords.into(),
            normal: touch.normal.into_inner().into(),
            force: touch.force,
        });
        HeldGrasp {
            object: self.subject.model.name.clone(),
            chain,
            palm_from_object: pose_to_array(&palm_from_object),
            joints: closed.scene.angles().iter().copied().collect(),
            start: pose_to_array(&closed.start),
            open_joints: closed.open.joints,
            tensions: closed.pull.tensions.iter().copied().collect(),
            opposition: closed.pull.opposition,
            contacts: contacts.collect(),
            palm: closed.touches.iter().any(|touch| touch.link.is_none()),
            room: self.room(closed, &free),
            digits,
            approach: facing.into(),
            margin: checked.margin,
            penetration: checked.penetration,
            moved: closed.moved.into(),
            energy: checked.sample.terms.total,
            proof: None,
        }
        .rounded()
    }

    /// Least distance of the free digits' surfaces from the object, m.
    fn room(&self, closed: &Closed, free: &[Digit]) -> Option<f64> {
        let object_from_palm = closed.scene.object().inverse();
        let links = self.hand.tree.forward(closed.scene.angles());
        let distances = free.iter().flat_map(|digit| self.hand.links(*digit)).flat_map(|&link| {
            let object_from_link = object_from_palm * links[link];
            let field = &self.subject.field;
            let points = &self.surface.links[link + 1].points;
            points.iter().map(move |p| field.distance(&(object_from_link * Point3::from(*p)).coords))
        });
        distances.reduce(f64::min)
    }
}
