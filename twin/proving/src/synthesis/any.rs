//! The search of grasps for a hand that is known from its URDF alone.
//!
//! [`describe`] finds surface, contact candidates and palm frame; the energy, the sampler and the checks are those of our own
//! hand; [`closing`] closes in physics with the hand's own actuators.

pub mod closing;
pub mod describe;

use std::time::Instant;

use anyhow::{Context, Result};
use grasping::synthesis::chain::{self, Schedule};
use grasping::synthesis::energy::{GraspEnergy, Weights};
use grasping::synthesis::frames::Frames;
use grasping::synthesis::held::{Proof, pose_to_array};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::closing::{AnyAim, AnyClosed};
use self::describe::Described;
use super::checks::{self, Hold};
use super::closing::NotClosed;
use super::load::Load;
use super::search::Verified;
use super::subject::Subject;
use super::synthesizer::Request;

/// Link (none for the root), point, unit normal into the object, normal force.
type AnyContact = (Option<usize>, [f64; 3], [f64; 3], f64);

/// A verified grasp of any hand. m, rad, N, root frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AnyHeld {
    /// Name of the hand.
    pub hand: String,
    /// Name of the object.
    pub object: String,
    /// Number of its chain.
    pub chain: u64,
    /// `root_from_object`: x, y, z, then i, j, k, w.
    pub root_from_object: [f64; 7],
    /// Joint angles, by name.
    pub joints: Vec<(String, f64)>,
    /// Tensions of the actuators, by name.
    pub tensions: Vec<(String, f64)>,
    pub contacts: Vec<AnyContact>,
    /// Wrench margin.
    pub margin: f64,
    /// Deepest overlap, of hand and object or of two links that collide.
    pub penetration: f64,
    /// What it was verified for.
    pub proof: Proof,
}

/// What a search came to.
#[derive(Debug, Clone, Default, Serialize)]
pub struct AnyReport {
    pub hand: String,
    pub object: String,
    pub candidates: usize,
    pub surface_points: usize,
    pub requested: u64,
    /// Chains that ended in a closed grasp.
    pub found: u64,
    pub blocked: u64,
    pub pushed_away: u64,
    /// Checks passed.
    pub verified: Verified,
    /// Verified grasps that still held when nothing pulled: has to be few.
    pub held_without_tension: u64,
    /// Mass (kg) and friction for which grasps are verified, and how much they hold.
    pub load: Load,
    pub wall_s: f64,
    /// What was found of the hand, in words; warnings begin with `WARNING`.
    pub notes: Vec<String>,
}

impl AnyReport {
    /// The report in words.
    pub fn text(&self) -> String {
        let share = |count: u64| format!("{count:5} ({:.1} %)", 100.0 * count as f64 / self.requested as f64);
        let rows = [
            format!(
                "{} on {}: {} chains, {:.1} s, {} surface points, {} candidates",
                self.hand, self.object, self.requested, self.wall_s, self.surface_points, self.candidates
            ),
            format!("closed            {}", share(self.found)),
            format!("  blocked         {}", share(self.blocked)),
            format!("  pushed away     {}", share(self.pushed_away)),
            format!("(a) cone program  {}", share(self.verified.a)),
            format!("(b) penetration   {}", share(self.verified.b)),
            format!("(c) held          {}", share(self.verified.c)),
            format!("all three         {}", share(self.verified.all)),
            format!("  of these held without tension {}", self.held_without_tension),
            self.load.text(),
        ];
        rows.map(|row| row + "\n").concat()
    }
}

/// How a chain ended.
struct End {
    verdicts: [bool; 3],
    held: Option<(AnyHeld, bool)>,
}

/// Runs all chains that are asked for; the verified grasps in the order of their chains.
pub fn search(hand: &Described, subject: &Subject, request: &Request) -> Result<(AnyReport, Vec<AnyHeld>)> {
    let start = Instant::now();
    let ends: Vec<Result<End, NotClosed>> = (0..request.chains)
        .into_par_iter()
        .map(|chain| run(hand, subject, request, chain).with_context(|| format!("chain {chain}")))
        .collect::<Result<_>>()?;
    let mut report = AnyReport {
        hand: hand.hand.name.clone(),
        object: subject.model.name.clone(),
        candidates: hand.surface.candidates.len(),
        surface_points: hand.surface.len(),
        requested: request.chains,
        notes: hand.notes.clone(),
        ..AnyReport::default()
    };
    let mut verified = Vec::new();
    for end in ends {
        match end {
            Err(NotClosed::Blocked) => report.blocked += 1,
            Err(NotClosed::PushedAway) => report.pushed_away += 1,
            Ok(end) => {
                report.found += 1;
                report.verified.add(end.verdicts);
                if let Some((held, slack)) = end.held {
                    report.held_without_tension += u64::from(slack);
                    verified.push(held);
                }
            }
        }
    }
    report.load = Load::of(&subject.model, verified.iter().map(|held| held.proof.payload));
    report.wall_s = start.elapsed().as_secs_f64();
    Ok((report, verified))
}

fn run(hand: &Described, subject: &Subject, request: &Request, number: u64) -> Result<Result<End, NotClosed>> {
    let energy =
        GraspEnergy::of_mechanism(hand.mechanism.clone(), &hand.surface, &subject.field, Weights::default(), None);
    let mut frames = Frames::new(&hand.tree);
    let mut rng = chain::stream(request.seed, number);
    let end = chain::run(&energy, &mut frames, request.contacts_of(number), &Schedule::default(), &mut rng);
    let actuators = hand.hand.pulls.len();
    let mass = subject.model.mass;
    let mut first = None;
    for attempt in 0..request.closings {
        let aim = if attempt == 0 { AnyAim::plain(actuators) } else { AnyAim::varied(actuators, &mut rng) };
        let closed = match closing::close(hand, subject, &end.best, &mut frames, &aim) {
            Ok(closed) => closed,
            Err(reason) => {
                first.get_or_insert(Err(reason));
                continue;
            }
        };
        let (margin, penetration) = (closing::margin(subject, &closed)?, closed.stand.penetration());
        let good = margin >= checks::LEAST_MARGIN && penetration <= checks::MOST_PENETRATION;
        if !good && attempt > 0 {
            continue;
        }
        let hold = closing::hold(&closed, &closed.tensions, mass);
        let verdicts = [margin >= checks::LEAST_MARGIN, penetration <= checks::MOST_PENETRATION, hold.held];
        if verdicts == [true; 3] {
            let slack: Hold = closing::hold(&closed, &vec![0.0; actuators], mass);
            let held = held(hand, subject, number, &closed, margin, penetration);
            return Ok(Ok(End { verdicts, held: Some((held, slack.held)) }));
        }
        if !matches!(first, Some(Ok(_))) {
            first = Some(Ok(End { verdicts, held: None }));
        }
    }
    Ok(first.unwrap_or(Err(NotClosed::Blocked)))
}

fn held(hand: &Described, subject: &Subject, chain: u64, closed: &AnyClosed, margin: f64, penetration: f64) -> AnyHeld {
    let names = hand.tree.joints.iter().map(|joint| joint.name.clone());
    let pulls = hand.hand.pulls.iter().map(|pull| pull.name.clone());
    let contacts = closed
        .touches
        .iter()
        .map(|touch| (touch.link, touch.point.coords.into(), touch.normal.into_inner().into(), touch.force));
    let model = &subject.model;
    let payload = checks::payload(model.mass, |mass| closing::hold(closed, &closed.tensions, mass).held);
    AnyHeld {
        hand: hand.hand.name.clone(),
        object: subject.model.name.clone(),
        chain,
        root_from_object: pose_to_array(&closing::object(&closed.stand)),
        joints: names.zip(closed.stand.angles().iter().copied()).collect(),
        tensions: pulls.zip(closed.tensions.iter().copied()).collect(),
        contacts: contacts.collect(),
        margin,
        penetration,
        proof: Proof { mass: model.mass, friction: model.friction, payload },
    }
}
