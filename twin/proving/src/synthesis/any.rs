//! The search of grasps for a hand that is known from its URDF alone.
//!
//! [`describe`] finds surface, contact candidates and palm frame; the energy, the sampler and the checks are those of our own
//! hand; [`closing`] closes in physics with the hand's own actuators. [`kinds`] sorts what was found.

pub mod closing;
pub mod describe;
pub mod kinds;
mod reach;
mod refusal;

use std::time::Instant;

use anyhow::{Context, Result};
use grasping::synthesis::chain::{self, Schedule};
use grasping::synthesis::energy::{GraspEnergy, Weights};
use grasping::synthesis::frames::Frames;
use grasping::synthesis::grasp_file::GraspWriter;
use grasping::synthesis::held::{AnyHeld, Proof, pose_to_array};
use indicatif::ProgressBar;
use rayon::prelude::*;
use serde::Serialize;

use self::closing::{AnyAim, AnyClosed};
use self::describe::Described;
use self::refusal::{Refusal, Refused};
use super::checks::{self, Hold};
use super::closing::NotClosed;
use super::load::Load;
use super::search::{BATCH, Verified, show_chains};
use super::subject::Subject;
use super::synthesizer::{Request, table};

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
    /// Checks passed; all three by grasps that were not refused.
    pub verified: Verified,
    /// Grasps that passed all three checks and are none all the same.
    pub refused: Refused,
    /// Verified grasps in which two digits press against each other.
    pub opposed: u64,
    /// Largest distance of a verified grasp's contact from its link's own surface, m; where it is kept, it lies on that.
    pub surface_gap: f64,
    /// Verified grasps that still held when nothing pulled: has to be few.
    pub held_without_tension: u64,
    /// Mass (kg) and friction for which grasps are verified, and how much they hold.
    pub load: Load,
    pub wall_s: f64,
    /// What was found of the hand, in words; warnings begin with `WARNING`.
    pub notes: Vec<String>,
}

impl AnyReport {
    fn refused(&self) -> u64 {
        let Refused { leans_on_fixed_part, contact_off_surface, unreachable } = &self.refused;
        leans_on_fixed_part + contact_off_surface + unreachable
    }

    /// A warning if the hand holds, but never between digits that oppose each other.
    fn opposition_warning(&self) -> Option<String> {
        (self.verified.all > 0 && self.opposed == 0).then(|| {
            format!(
                "WARNING none of the {} grasps uses opposed digits: the object is held against the palm or on one side only; are all digits \
                 pulled, and with the right signs?",
                self.verified.all
            )
        })
    }

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
            format!("refused           {}", share(self.refused())),
            format!("  on a fixed part {}", share(self.refused.leans_on_fixed_part)),
            format!("  off the surface {}", share(self.refused.contact_off_surface)),
            format!("  out of reach    {}", share(self.refused.unreachable)),
            format!("all three         {}", share(self.verified.all)),
            format!("  of these with opposed digits {}", self.opposed),
            format!("  contacts within {:.1} mm of the links' own surfaces", 1e3 * self.surface_gap),
            format!("  of these held without tension {}", self.held_without_tension),
            self.load.text(),
        ];
        rows.into_iter().chain(self.opposition_warning()).map(|row| row + "\n").collect()
    }
}

/// How a chain ended.
struct End {
    verdicts: [bool; 3],
    /// The reason for which it is no grasp though it passed all three.
    refusal: Option<Refusal>,
    held: Option<Kept>,
}

/// A verified grasp with what the report says of it.
struct Kept {
    held: AnyHeld,
    opposes: bool,
    /// m.
    surface_gap: f64,
}

/// Runs all chains that are asked for; every verified grasp goes to `writer` when its batch is done. Answers with what it came to and
/// the verified grasps in the order of their chains.
pub fn search(
    hand: &Described,
    subject: &Subject,
    request: &Request,
    mut writer: Option<GraspWriter>,
    progress: &ProgressBar,
) -> Result<(AnyReport, Vec<AnyHeld>)> {
    let start = Instant::now();
    let mut report = AnyReport {
        hand: hand.hand.name.clone(),
        object: subject.model.name.clone(),
        candidates: hand.surface.candidates.len(),
        surface_points: hand.surface.len(),
        requested: request.chains,
        notes: hand.notes.clone(),
        ..AnyReport::default()
    };
    show_chains(progress, &report.object, request.chains)?;
    let mut verified = Vec::new();
    for first in (0..request.chains).step_by(BATCH as usize) {
        let ends: Vec<Result<End, NotClosed>> = (first..(first + BATCH).min(request.chains))
            .into_par_iter()
            .map(|chain| {
                let end = run(hand, subject, request, chain).with_context(|| format!("chain {chain}"));
                progress.inc(1);
                end
            })
            .collect::<Result<_>>()?;
        for end in ends {
            match end {
                Err(NotClosed::Blocked) => report.blocked += 1,
                Err(NotClosed::PushedAway) => report.pushed_away += 1,
                Ok(end) => {
                    report.found += 1;
                    report.verified.add(end.verdicts);
                    if let Some(refusal) = end.refusal {
                        report.refused.add(refusal);
                        report.verified.all -= 1;
                    }
                    let Some(Kept { held, opposes, surface_gap }) = end.held else { continue };
                    report.opposed += u64::from(opposes);
                    report.surface_gap = report.surface_gap.max(surface_gap);
                    report.held_without_tension += u64::from(held.held_without_tension);
                    if let Some(writer) = &mut writer {
                        writer.add(&held.clone().with_frame_moved(&subject.origin))?;
                    }
                    verified.push(held);
                }
            }
        }
        progress.set_message(report.verified.all.to_string());
    }
    progress.finish_and_clear();
    report.load = Load::of(&subject.model, verified.iter().map(|held| held.proof.payload));
    report.wall_s = start.elapsed().as_secs_f64();
    report.notes.extend(report.opposition_warning());
    Ok((report, verified))
}

fn run(hand: &Described, subject: &Subject, request: &Request, number: u64) -> Result<Result<End, NotClosed>> {
    let table = request.table.then(|| table(&subject.model));
    let mut energy =
        GraspEnergy::of_mechanism(hand.mechanism.clone(), &hand.surface, &subject.field, Weights::default(), table);
    energy.places = &subject.places;
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
        let hold = checks::hold(&closed, mass);
        let verdicts = [margin >= checks::LEAST_MARGIN, penetration <= checks::MOST_PENETRATION, hold.held];
        let refusal = if verdicts == [true; 3] { refusal::of(hand, subject, &closed, table.as_ref()) } else { None };
        if verdicts == [true; 3] && refusal.is_none() {
            let slack = AnyClosed { tensions: vec![0.0; actuators], ..closed.clone() };
            let slack = checks::hold(&slack, mass).held;
            let held = held(hand, subject, number, &closed, [margin, penetration], &hold, slack);
            let links = closed.stand.links();
            let surface_gap = closed.touches.iter().map(|touch| refusal::gap(hand, &links, touch)).fold(0.0, f64::max);
            let kept = Kept { held, opposes: refusal::opposes(hand, &closed.touches), surface_gap };
            return Ok(Ok(End { verdicts, refusal: None, held: Some(kept) }));
        }
        // A refused grasp tells more of the chain than one that fails a check.
        if refusal.is_some() || !matches!(first, Some(Ok(_))) {
            first = Some(Ok(End { verdicts, refusal, held: None }));
        }
    }
    Ok(first.unwrap_or(Err(NotClosed::Blocked)))
}

/// A closed grasp as it is kept.
fn held(
    hand: &Described,
    subject: &Subject,
    chain: u64,
    closed: &AnyClosed,
    [margin, penetration]: [f64; 2],
    hold: &Hold,
    held_without_tension: bool,
) -> AnyHeld {
    let by_joint = |angles: &[f64]| {
        hand.tree.joints.iter().map(|joint| joint.name.clone()).zip(angles.iter().copied()).collect::<Vec<_>>()
    };
    let by_pull = |tensions: &[f64]| {
        hand.hand.pulls.iter().map(|pull| pull.name.clone()).zip(tensions.iter().copied()).collect::<Vec<_>>()
    };
    let links = closed.stand.links();
    let contacts = closed.touches.iter().map(|touch| {
        let point = refusal::on_surface(hand, &links, touch);
        (touch.link, point.coords.into(), touch.normal.into_inner().into(), touch.force)
    });
    let model = &subject.model;
    let payload = checks::payload(closed, model.mass, hold);
    AnyHeld {
        object: model.name.clone(),
        chain,
        root_from_object: pose_to_array(&closed.stand.object()),
        joints: by_joint(closed.stand.angles()),
        start: pose_to_array(&closed.open.start),
        open_joints: by_joint(&closed.open.joints),
        open_tensions: by_pull(&closed.open.tensions),
        tensions: by_pull(&closed.tensions),
        contacts: contacts.collect(),
        margin,
        penetration,
        held_without_tension,
        proof: Proof { mass: model.mass, friction: model.friction, payload },
    }
}
