//! `ftac grasps generate`: a chain per grasp asked for, each closed and verified; what was found is written as it is found.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use grasping::synthesis::chain::{self, Sample, Schedule};
use grasping::synthesis::energy::{GraspEnergy, Plane, Weights};
use grasping::synthesis::frames::Frames;
use grasping::synthesis::held::{HeldContact, HeldGrasp, HeldWriter, pose_to_array};
use grasping::synthesis::surface::HandSurface;
use hand_model::{Digit, Hand};
use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::{Point3, Unit, Vector3};
use rayon::prelude::*;
use serde::Serialize;

use super::checks::{self, Hold};
use super::closing::{self, Closed, NotClosed};
use super::subject::Subject;

/// Points on the hand's surface.
pub const SURFACE_POINTS: usize = 2000;
/// Chains between two visits to the file: all threads have work, and an interruption loses little.
const BATCH: u64 = 32;

/// What to search for.
#[derive(Debug, Clone, Copy)]
pub struct Request {
    /// Chains at most, each of which may leave one grasp.
    pub chains: u64,
    /// Enough grasps: the search stops after the batch of chains that reaches it, and keeps no more.
    pub enough: usize,
    /// Contact points of a chain: this many at least and at most, taken in turn.
    pub contacts: (usize, usize),
    /// Seed of all chains.
    pub seed: u64,
    /// Whether the object rests on a table, which the hand keeps out of.
    pub table: bool,
}

/// Everything that chains share.
pub struct Workshop {
    /// The hand.
    pub hand: Arc<Hand>,
    /// Its surface.
    pub surface: HandSurface,
    /// The object.
    pub subject: Subject,
    request: Request,
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
}

impl Checked {
    /// Verdicts (a), (b), (c).
    pub fn verdicts(&self) -> [bool; 3] {
        let margin = self.margin >= checks::LEAST_MARGIN;
        [margin, self.penetration <= checks::MOST_PENETRATION, self.hold.held]
    }
}

/// How a chain ended.
pub struct ChainResult {
    /// Iterations of the sampler.
    pub steps: usize,
    /// Seconds of its thread in the sampler.
    pub sampling_s: f64,
    /// The closed grasp, or why there is none.
    pub end: Result<Checked, NotClosed>,
}

impl Workshop {
    /// For one object.
    pub fn new(subject: Subject, request: Request) -> Self {
        let hand = Arc::new(Hand::ftac());
        let surface = HandSurface::new(&hand, SURFACE_POINTS);
        Self { hand, surface, subject, request, schedule: Schedule::default() }
    }

    fn table(&self) -> Option<Plane> {
        let model = &self.subject.model;
        let up = model.rest.inverse() * Vector3::z();
        self.request.table.then(|| Plane { normal: Unit::new_normalize(up), offset: -model.rest_height() })
    }

    /// Runs chain number `chain`, closes its best sample and checks it.
    pub fn run(&self, chain: u64) -> Result<ChainResult> {
        let energy = GraspEnergy::new(&self.hand, &self.surface, &self.subject.field, Weights::default(), self.table());
        let mut frames = Frames::new(&self.hand.tree);
        let (fewest, most) = self.request.contacts;
        let contacts = fewest + (chain as usize) % (most - fewest + 1);
        let mut rng = chain::stream(self.request.seed, chain);
        let start = Instant::now();
        let end = chain::run(&energy, &mut frames, contacts, &self.schedule, &mut rng);
        let sampling_s = start.elapsed().as_secs_f64();
        let closed = closing::close(&self.hand, &self.surface, &self.subject, &end.best, &mut frames);
        let end_of = match closed {
            Err(reason) => Err(reason),
            Ok(closed) => {
                let margin = checks::margin(&self.subject, &closed).with_context(|| format!("chain {chain}"))?;
                let penetration = checks::penetration(&self.hand, &self.surface, &self.subject, &closed);
                let hold = checks::hold(&closed.scene, &closed.pull);
                Ok(Checked { sample: end.best, closed, margin, penetration, hold })
            }
        };
        Ok(ChainResult { steps: end.steps, sampling_s, end: end_of })
    }

    /// The grasp as it is kept.
    pub fn held(&self, chain: u64, checked: &Checked) -> HeldGrasp {
        let closed = &checked.closed;
        let palm_from_object = closed.scene.object();
        let touching = |digit: &Digit| {
            closed.touches.iter().any(|touch| touch.link.is_some_and(|link| digit.joints().contains(&link)))
        };
        let (digits, free): (Vec<Digit>, Vec<Digit>) = Digit::ALL.into_iter().partition(touching);
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
            joints: *closed.scene.angles(),
            start: pose_to_array(&closed.start),
            open_joints: closed.opened.open.joints,
            tensions: closed.pull.tensions,
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
        }
        .rounded()
    }

    /// Least distance of the free digits' surfaces from the object, m.
    fn room(&self, closed: &Closed, free: &[Digit]) -> Option<f64> {
        let object_from_palm = closed.scene.object().inverse();
        let links = self.hand.tree.forward(closed.scene.angles());
        let distances = free.iter().flat_map(|digit| digit.joints()).flat_map(|link| {
            let object_from_link = object_from_palm * links[link];
            let field = &self.subject.field;
            let points = &self.surface.links[link + 1].points;
            points.iter().map(move |p| field.distance(&(object_from_link * Point3::from(*p)).coords))
        });
        distances.reduce(f64::min)
    }
}

/// Counts of passed checks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
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

/// What a search came to.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Report {
    /// Object.
    pub object: String,
    /// Chains run.
    pub requested: u64,
    /// Chains that ended in a closed grasp.
    pub found: u64,
    /// Chains whose posture could not be opened clear of the object.
    pub blocked: u64,
    /// Chains whose closing digits pushed the object away.
    pub pushed_away: u64,
    /// Checks passed.
    pub verified: Verified,
    /// Verified grasps that nearly equal an earlier one; they are not written.
    pub duplicates: u64,
    /// Grasps kept and written.
    pub kept: usize,
    /// Wall time, s.
    pub wall_s: f64,
    /// Iterations of the sampler per second and thread.
    pub grasp_steps_per_s: f64,
    /// Digits used, by name, in verified grasps.
    pub digits: std::collections::BTreeMap<&'static str, u64>,
}

/// Runs all chains; every verified grasp that is no near duplicate goes to `writer` when its batch is done.
pub fn search(workshop: &Workshop, mut writer: Option<HeldWriter>, quiet: bool) -> Result<Report> {
    let start = Instant::now();
    let request = workshop.request;
    let mut report = Report { object: workshop.subject.model.name.clone(), ..Report::default() };
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(request.chains) };
    bar.set_style(ProgressStyle::with_template("{bar:30} {pos}/{len} chains, {msg} verified [{elapsed} < {eta}]")?);
    let (mut steps, mut sampling_s) = (0, 0.0);
    let mut kept: Vec<HeldGrasp> = Vec::new();
    for first in (0..request.chains).step_by(BATCH as usize) {
        if kept.len() >= request.enough {
            break;
        }
        let chains = first..(first + BATCH).min(request.chains);
        let results: Vec<(u64, ChainResult)> =
            chains.into_par_iter().map(|chain| Ok((chain, workshop.run(chain)?))).collect::<Result<_>>()?;
        for (chain, result) in results {
            steps += result.steps;
            sampling_s += result.sampling_s;
            report.requested += 1;
            bar.inc(1);
            let checked = match result.end {
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
            if checked.verdicts() != [true; 3] {
                continue;
            }
            let grasp = workshop.held(chain, &checked);
            for digit in &grasp.digits {
                *report.digits.entry(digit.name()).or_default() += 1;
            }
            if kept.iter().any(|other| other.nearly_equals(&grasp)) {
                report.duplicates += 1;
                continue;
            }
            if kept.len() < request.enough {
                if let Some(writer) = &mut writer {
                    writer.add(&grasp)?;
                }
                kept.push(grasp);
            }
        }
        bar.set_message(report.verified.all.to_string());
    }
    bar.finish_and_clear();
    report.kept = kept.len();
    report.wall_s = start.elapsed().as_secs_f64();
    report.grasp_steps_per_s = steps as f64 / sampling_s;
    Ok(report)
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
    use super::*;

    fn verified(threads: usize) -> (Verified, Vec<String>) {
        let request = Request { chains: 6, enough: usize::MAX, contacts: (5, 5), seed: 3, table: false };
        let workshop = Workshop::new(Subject::named("ball").expect("the ball"), request);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("held.jsonl");
        let header = grasping::synthesis::held::Header { version: 1, command: String::new(), seed: 3 };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let writer = HeldWriter::create(&path, &header).expect("created");
        let report = pool.install(|| search(&workshop, Some(writer), true)).expect("searched");
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
