//! The policy `touch`: decides by what is felt, and tries again what touch says has failed.

use std::collections::BTreeMap;
use std::time::Instant;

use anyhow::{Result, anyhow};
use control::executive::{Percept, Phase};
use control::perception::{Felt, Grip, feel, grip};
use control::recovery::{Next, probe};
use control::sensing::Senses;
use control::stand_in::stand_ins;
use control::strategy::{Candidate, Decision, Held, choose};
use control::trajectory::PosePath;
use grasping::{Grasp, Role};
use nalgebra::{Point3, Vector3};
use rand_chacha::ChaCha8Rng;
use scenarios::Sensing;
use scenarios::noise::TrialNoise;
use scenarios::objects::ObjectModel;
use scenarios::record::{Condition, TrialRecord};
use scenarios::referee::FailureCause;
use sim::robot::Truth;

use super::{Bench, Part, Planned, Run, Start, Watcher};
use proving::rehearsal::in_hand;
use proving::world::percept;

/// What a grasp that failed in this very trial is still worth.
const FAILED_WORTH: f64 = 0.5;
/// What a first grasp other than the planned one counts against its score: it was not rehearsed with the second object.
const UNPLANNED_WORTH: f64 = 0.9;
/// Time that a trial needs from a new try of the first object to its end, s: none begins later.
const TRY_TIME: f64 = 14.0;

/// Turns about the vertical that are tried when an object is out of the planned grasp's reach, rad.
pub const TURNS: [f64; 15] = [0.0, 0.2, -0.2, 0.4, -0.4, 0.6, -0.6, 0.8, -0.8, 1.0, -1.0, 1.2, -1.2, 1.4, -1.4];

/// What the policy did in a trial, for its record.
#[derive(Default)]
struct Story {
    retries: u32,
    switched: bool,
    reasons: Vec<String>,
    slowest_ms: f64,
}

impl Story {
    /// Whether everything so far is what the plan says.
    fn as_planned(&self) -> bool {
        self.retries == 0 && !self.switched
    }
}

/// What the policy knows while a trial goes on.
struct Adaptation<'a> {
    start: &'a Start,
    senses: Senses<'a>,
    run: Run,
    story: Story,
    /// Grasps for the first and for the second object, while they stand as the plan expects them.
    candidates: [Vec<Candidate>; 2],
    /// How often each grasp of the first and of the second object, by its number, has failed.
    failures: [BTreeMap<u32, i32>; 2],
    /// Grasps that failed in a row.
    in_a_row: usize,
    /// Where the hand aims beside what is seen, m: kept while it works.
    aim: Vector3<f64>,
    felt: Option<Felt>,
    /// Where everything was when the first object's pose was estimated last.
    held: Option<Truth>,
}

impl Bench {
    /// The branch `touch`, with what `sensing` leaves of the senses. `planned` is what blind did: as long as touch does nothing
    /// else, it is where blind was, bit by bit.
    pub(super) fn adapt(
        &self,
        start: &Start,
        id: (usize, usize, Condition),
        sensing: Sensing,
        planned: Option<&Planned>,
        rng: &mut ChaCha8Rng,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialRecord> {
        let condition = id.2;
        watcher.branch(condition)?;
        let mut now = Adaptation {
            start,
            senses: Senses::new(self.pipeline_of(start), sensing)?,
            run: start.run.clone(),
            story: Story::default(),
            candidates: [self.first_candidates(start), start.candidates.clone()],
            failures: Default::default(),
            in_a_row: 0,
            aim: Vector3::zeros(),
            felt: None,
            held: None,
        };
        loop {
            let phase = now.run.snapshot.executive.phase();
            let begun = Instant::now();
            let grip = match phase {
                Phase::Decide => {
                    let felt = self.spent.on(Part::Perception, || self.feel(&now, sensing))?;
                    now.story.reasons.extend(felt.faults.iter().map(|fault| format!("left out: {fault}")));
                    let grip = felt.grip;
                    now.felt = Some(felt);
                    grip
                }
                _ => match now.run.snapshot.robot.truth().filter(|_| sensing == Sensing::TruePose) {
                    Some(truth) => grip_of(&truth),
                    None => self.spent.on(Part::Perception, || grip(&now.senses, &now.run.snapshot.executive))?,
                },
            };
            let late = now.run.snapshot.robot.time() + TRY_TIME > self.world.scenario.protocol.time_limit;
            let next = if late { Next::GoOn } else { Next::after(phase, grip) };
            match (phase, next) {
                (Phase::Done, Next::GoOn) => break,
                (Phase::Confirm, Next::GoOn) => {
                    match planned.filter(|_| now.story.as_planned()) {
                        Some(planned) => now.run = planned.done.clone(),
                        None => {
                            now.run.snapshot.executive.confirm()?;
                            now.run.watch(Phase::Done, now.felt.as_ref(), Some(condition), watcher)?;
                        }
                    }
                    continue;
                }
                _ => {}
            }
            if next != Next::GoOn {
                now.story.retries += 1;
                now.story.reasons.push(next.reason().to_owned());
                now.run.tell(next.reason(), now.felt.as_ref(), condition, watcher)?;
                now.mark_down(next, self.world.scenario.noise.execution.position_sigma);
            } else {
                now.in_a_row = 0;
            }
            let begun_to_move = match next {
                Next::FirstAgain => self.first_again(&mut now, rng),
                Next::StartOver => {
                    now.run.snapshot.executive.put_down()?;
                    now.run.watch(Phase::Decide, None, Some(condition), watcher)?;
                    self.first_again(&mut now, rng)
                }
                Next::GoOn | Next::SecondAgain => {
                    if next == Next::SecondAgain {
                        self.look_at_second(&mut now, rng)?;
                    } else {
                        now.held = now.run.snapshot.robot.truth();
                    }
                    let decision = self.take_second(&mut now, planned)?;
                    now.story.slowest_ms = now.story.slowest_ms.max(begun.elapsed().as_secs_f64() * 1e3);
                    match decision {
                        Some(reason) => {
                            now.run.tell(&reason, now.felt.as_ref(), condition, watcher)?;
                            now.story.reasons.push(reason);
                            Ok(())
                        }
                        None => Err(out_of_reach(&start.objects[1], &now.run.snapshot.executive.second().1)),
                    }
                }
            };
            if let Err(error) = begun_to_move {
                now.story.reasons.push(error.to_string());
                now.run.referee.give_up(FailureCause::Unreachable);
                break;
            }
            let executive = &now.run.snapshot.executive;
            let until = if executive.phase() < Phase::Decide { Phase::Decide } else { Phase::Confirm };
            let felt = now.felt.as_ref().filter(|_| until == Phase::Confirm);
            now.run.watch(until, felt, Some(condition), watcher)?;
        }
        now.story.reasons.extend(now.run.slips());
        let mut record = match planned.filter(|_| now.story.as_planned()) {
            Some(planned) => TrialRecord { condition, ..planned.record.clone() },
            None => now.run.record(start, id)?,
        };
        record.switched = !now.story.as_planned();
        record.retries = now.story.retries;
        record.reason = now.story.reasons.join("; ");
        record.decision_ms = (now.story.slowest_ms > 0.0).then_some(now.story.slowest_ms);
        if let (Some(held), Some(felt)) = (&now.held, &now.felt) {
            note_pose(&mut record, held, start, felt);
        }
        watcher.outcome(&record)?;
        Ok(record)
    }

    /// What the look tells. The upper bound of all sensing is told the truth, by the referee's side door.
    fn feel(&self, now: &Adaptation, sensing: Sensing) -> Result<Felt> {
        let executive = &now.run.snapshot.executive;
        let mut felt = feel(&now.senses, executive, &self.known[&now.start.objects[0].name])?;
        if let (Sensing::TruePose, Some(truth)) = (sensing, now.run.snapshot.robot.truth()) {
            felt.estimate.palm_from_object = truth.palm.inverse() * truth.objects[0];
            felt.estimate.covariance.fill(0.0);
            felt.grip = grip_of(&truth);
        }
        Ok(felt)
    }

    /// Decides how to take the second object and begins; the reason, or nothing if none of its grasps is in reach.
    fn take_second(&self, now: &mut Adaptation, planned: Option<&Planned>) -> Result<Option<String>> {
        let seen = now.run.snapshot.executive.second().1;
        let mut within = self.spent.on(Part::Choice, || self.within_reach(now, Role::Second, &seen));
        loop {
            let Some(felt) = now.felt.as_ref().filter(|_| !within.is_empty()) else { return Ok(None) };
            let decision = self.spent.on(Part::Choice, || self.choose(&now.run, now.start, &within, felt))?;
            // What was rehearsed before the trial needs no rehearsal.
            if let Some(planned) = planned.filter(|_| now.story.as_planned() && !decision.switched) {
                now.run = planned.confirm.clone();
                return Ok(Some(decision.reason));
            }
            let executive = &mut now.run.snapshot.executive;
            let Some(way) = self.spent.on(Part::Choice, || executive.way(&decision.grasp, &seen)) else {
                within.retain(|candidate| candidate.grasp.id != decision.grasp.id);
                continue;
            };
            now.story.switched |= decision.switched;
            executive.decide(decision.grasp)?;
            executive.go(way);
            return Ok(Some(decision.reason));
        }
    }

    /// The grasps of the first object, the planned one first.
    fn first_candidates(&self, start: &Start) -> Vec<Candidate> {
        let planned = start.run.snapshot.executive.first().0.clone();
        let others = self.repertoire.of(&start.objects[0].name, Role::First).filter(|grasp| grasp.id != planned.id);
        let others = others.map(|grasp| Candidate { worth: UNPLANNED_WORTH * grasp.score, grasp: grasp.clone() });
        std::iter::once(Candidate { worth: planned.score, grasp: planned.clone() }).chain(others).collect()
    }

    /// The grasp for the second object, given what is felt of the first.
    fn choose(&self, run: &Run, start: &Start, candidates: &[Candidate], felt: &Felt) -> Result<Decision> {
        let executive = &run.snapshot.executive;
        let held = Held {
            object: &start.objects[0],
            pose: felt.estimate.palm_from_object,
            joints: felt.estimate.q.to_vec(),
            digits: executive.first().0.role.digits(),
            sigma: felt.estimate.sigma().0.min(0.01),
        };
        let noise = &self.world.scenario.noise;
        let sigma = noise.execution.position_sigma.hypot(noise.perception.xy_sigma);
        choose(executive, &self.world.cell.hand, &held, &start.objects[1], candidates, sigma)?
            .ok_or_else(|| anyhow!("the plan of {} has no second grasp", start.objects[1].name))
    }

    /// The candidates whose grasp the arm reaches, if need be turned about the vertical; for an object that fell over, grasps of
    /// what lies like it.
    fn within_reach(&self, now: &Adaptation, role: Role, seen: &Percept) -> Vec<Candidate> {
        let index = usize::from(role == Role::Second);
        let object = &*now.start.objects[index];
        let turned = |candidate: &Candidate| {
            let grasp = self.turned(&candidate.grasp, seen, object).next()?;
            let failures = now.failures[index].get(&grasp.id).copied().unwrap_or(0);
            Some(Candidate { worth: candidate.worth * FAILED_WORTH.powi(failures), grasp })
        };
        let own: Vec<Candidate> = match object.standing_yaw(&seen.rotation) {
            Some(_) => now.candidates[index].iter().filter_map(turned).collect(),
            None => Vec::new(),
        };
        if !own.is_empty() {
            return own;
        }
        stand_ins(&self.world.objects, &self.repertoire, object, seen, role).iter().filter_map(turned).collect()
    }

    /// `grasp` from all sides from which the object looks the same, as far as the arm has a posture for it: unturned first.
    fn turned<'a>(
        &'a self,
        grasp: &'a Grasp,
        seen: &'a Percept,
        object: &ObjectModel,
    ) -> impl Iterator<Item = Grasp> + use<'a> {
        let turns = if object.round_about_vertical(&seen.rotation) {
            TURNS.to_vec()
        } else {
            let others = object.standing_yaws(&seen.rotation).into_iter().map(|yaw| yaw - seen.yaw);
            std::iter::once(0.0).chain(others.filter(|turn| turn.abs() > 1e-6)).collect()
        };
        turns.into_iter().map(|turn| Grasp { yaw: grasp.yaw + turn, ..grasp.clone() }).filter(|grasp| {
            let target = grasp.palm_pose(&seen.position, seen.yaw);
            self.world.posture(&target, &self.world.cell.ready).is_ok()
        })
    }

    /// The best of `candidates` that the arm gets to from where it is, and how.
    fn best_way(&self, now: &Adaptation, mut candidates: Vec<Candidate>, seen: &Percept) -> Option<(Grasp, PosePath)> {
        candidates.sort_by(|a, b| b.worth.total_cmp(&a.worth));
        let object = &now.start.objects[0];
        let executive = &now.run.snapshot.executive;
        candidates.iter().find_map(|candidate| {
            self.turned(&candidate.grasp, seen, object)
                .find_map(|grasp| executive.way(&grasp, seen).map(|way| (grasp, way)))
        })
    }

    /// Prior perception looks at object `index` anew, with an error of its own; the hand aims beside it as it has learnt to.
    fn seen(&self, now: &mut Adaptation, index: usize, rng: &mut ChaCha8Rng) -> Result<Percept> {
        let noise = TrialNoise::draw(&self.world.scenario.noise, rng).objects[index];
        let seen = percept(&now.start.objects[index], &now.run.look(index, &noise)?);
        Ok(Percept { position: seen.position + now.aim, ..seen })
    }

    fn look_at_second(&self, now: &mut Adaptation, rng: &mut ChaCha8Rng) -> Result<()> {
        let seen = self.seen(now, 1, rng)?;
        now.run.snapshot.executive.see_second(seen);
        Ok(())
    }

    fn first_again(&self, now: &mut Adaptation, rng: &mut ChaCha8Rng) -> Result<()> {
        let object = &now.start.objects[0];
        let seen = self.seen(now, 0, rng)?;
        self.look_at_second(now, rng)?;
        let within = self.spent.on(Part::Choice, || self.within_reach(now, Role::First, &seen));
        let best = self.spent.on(Part::Choice, || self.best_way(now, within, &seen));
        let (grasp, way) = best.ok_or_else(|| out_of_reach(object, &seen))?;
        let executive = &mut now.run.snapshot.executive;
        executive.retry_first(grasp, seen)?;
        executive.go(way);
        Ok(())
    }
}

impl Adaptation<'_> {
    /// A grasp that just failed is worth less for the rest of the trial, and the next one aims elsewhere. `sigma` is the arm's.
    fn mark_down(&mut self, next: Next, sigma: f64) {
        let executive = &self.run.snapshot.executive;
        let (object, failed) = match next {
            Next::GoOn => return,
            Next::FirstAgain | Next::StartOver => (0, executive.first().0.id),
            Next::SecondAgain => (1, executive.second().0.id),
        };
        *self.failures[object].entry(failed).or_default() += 1;
        if next != Next::StartOver {
            self.in_a_row += 1;
            if self.in_a_row > 1 {
                self.aim = probe(self.in_a_row, sigma);
            }
        }
    }
}

/// What is truly in the hand.
fn grip_of(truth: &Truth) -> Grip {
    Grip { first: in_hand(truth, 0), second: in_hand(truth, 1) }
}

/// Why an object cannot be grasped where it is seen.
fn out_of_reach(object: &ObjectModel, seen: &Percept) -> anyhow::Error {
    let tilt = (seen.rotation * object.rest.inverse() * Vector3::z()).angle(&Vector3::z()).to_degrees();
    let Point3 { coords } = seen.position;
    anyhow!(
        "no grasp of {} is in reach at ({:.2}, {:.2}, {:.2}) m, tilted by {tilt:.0} deg",
        object.name,
        coords.x,
        coords.y,
        coords.z
    )
}

/// What the referee knows about the estimate, for the record only.
fn note_pose(record: &mut TrialRecord, truth: &Truth, start: &Start, felt: &Felt) {
    // A dropped object has no place in the hand that could be estimated.
    if !in_hand(truth, 0) {
        return;
    }
    let real = truth.palm.inverse() * truth.objects[0];
    let estimate = felt.estimate.palm_from_object;
    let apart = |pose: &nalgebra::Isometry3<f64>| (pose.translation.vector - real.translation.vector).norm() * 1e3;
    record.pose_error_mm = Some(apart(&estimate));
    record.prior_error_mm = Some(apart(&felt.prior));
    record.pose_error_deg = Some(start.objects[0].symmetry.angle(&real.rotation, &estimate.rotation).to_degrees());
}
