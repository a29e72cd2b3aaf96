//! The policy `touch`: decides by what is felt, and tries again what touch says has failed.

use std::time::Instant;

use anyhow::{Context as _, Result};
use control::executive::{Percept, Phase};
use control::perception::{Felt, feel, grip};
use control::recovery::Next;
use control::strategy::{Candidate, Decision, Held, choose};
use grasping::Grasp;
use rand_chacha::ChaCha8Rng;
use scenarios::noise::TrialNoise;
use scenarios::objects::ObjectModel;
use scenarios::record::{Condition, TrialRecord};
use scenarios::referee::FailureCause;
use sim::robot::Truth;

use super::{Bench, Run, Start, Watcher};
use crate::rehearsal::in_hand;
use crate::world::percept;

/// What a second grasp that failed in this very trial is still worth.
const FAILED_WORTH: f64 = 0.5;
/// Time that a trial needs from a new try of the first object to its end, s: none begins later.
const TRY_TIME: f64 = 14.0;

/// Turns about the vertical that are tried when an object is out of the planned grasp's reach, rad.
const TURNS: [f64; 9] = [0.0, 0.2, -0.2, 0.4, -0.4, 0.6, -0.6, 0.8, -0.8];

/// What the policy did in a trial, for its record.
#[derive(Default)]
struct Story {
    retries: u32,
    switched: bool,
    reasons: Vec<String>,
    slowest_ms: f64,
}

impl Bench {
    /// The branch `touch`. `planned` is where the blind plan stands after the second lift and `blind` how that ended: what touch
    /// does not do otherwise has the same outcome, bit by bit.
    pub(super) fn adapt(
        &self,
        start: &Start,
        id: (usize, usize, Condition),
        planned: Option<&Run>,
        blind: Option<&TrialRecord>,
        rng: &mut ChaCha8Rng,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialRecord> {
        let condition = id.2;
        watcher.branch(condition)?;
        let mut run = start.run.clone();
        let mut story = Story::default();
        let mut candidates = start.candidates.clone();
        let mut felt: Option<Felt> = None;
        let mut held: Option<Truth> = None;
        loop {
            let phase = run.snapshot.executive.phase();
            let begun = Instant::now();
            let (now, grip) = match phase {
                Phase::Decide => {
                    let now =
                        feel(self.pipeline_of(start), &run.snapshot.executive, &self.known[&start.objects[0].name])?;
                    let grip = now.grip;
                    (Some(now), grip)
                }
                _ => (None, grip(self.pipeline_of(start), &run.snapshot.executive)?),
            };
            let late = run.snapshot.robot.time() + TRY_TIME > self.world.scenario.protocol.time_limit;
            let next = if late { Next::GoOn } else { Next::after(phase, grip) };
            if next == Next::GoOn && now.is_none() {
                break;
            }
            felt = now.or(felt);
            if next != Next::GoOn {
                story.retries += 1;
                story.reasons.push(next.reason().to_owned());
                run.tell(next.reason(), felt.as_ref(), condition, watcher)?;
            }
            let begun_to_move = match (next, &felt) {
                (Next::FirstAgain, _) => self.first_again(&mut run, start, rng),
                (Next::StartOver, _) => {
                    run.snapshot.executive.put_down()?;
                    run.watch(Phase::Decide, None, Some(condition), watcher)?;
                    self.first_again(&mut run, start, rng)
                }
                (Next::GoOn | Next::SecondAgain, Some(felt)) => {
                    if next == Next::SecondAgain {
                        self.look_at_second(&mut run, start, rng)?;
                        let failed = run.snapshot.executive.second().0.id;
                        for candidate in candidates.iter_mut().filter(|candidate| candidate.grasp.id == failed) {
                            candidate.worth *= FAILED_WORTH;
                        }
                    } else {
                        held = run.snapshot.robot.truth();
                    }
                    let seen = run.snapshot.executive.second().1;
                    let within = self.within_reach(&candidates, &seen, &start.objects[1]);
                    if within.is_empty() {
                        run.referee.give_up(FailureCause::Unreachable);
                        break;
                    }
                    let decision = self.choose(&run, start, &within, felt)?;
                    story.slowest_ms = story.slowest_ms.max(begun.elapsed().as_secs_f64() * 1e3);
                    story.switched |= decision.switched;
                    run.tell(&decision.reason, Some(felt), condition, watcher)?;
                    story.reasons.push(decision.reason);
                    match planned.filter(|_| !story.switched && story.retries == 0) {
                        Some(planned) => {
                            run = planned.clone();
                            Ok(())
                        }
                        None => run.snapshot.executive.decide(decision.grasp).map_err(Into::into),
                    }
                }
                // The second object is only tried with the first one felt.
                (Next::GoOn | Next::SecondAgain, None) => break,
            };
            if begun_to_move.is_err() {
                run.referee.give_up(FailureCause::Unreachable);
                break;
            }
            let until = if run.snapshot.executive.phase() < Phase::Decide { Phase::Decide } else { Phase::Confirm };
            run.watch(until, felt.as_ref().filter(|_| until == Phase::Confirm), Some(condition), watcher)?;
        }
        let alike = blind.filter(|_| planned.is_some() && story.retries == 0 && !story.switched);
        let mut record = match alike {
            Some(blind) => TrialRecord { condition, ..blind.clone() },
            None => self.carry(run, start, id, felt.as_ref(), watcher)?,
        };
        record.switched = story.switched || story.retries > 0;
        record.retries = story.retries;
        record.reason = story.reasons.join("; ");
        record.decision_ms = (story.slowest_ms > 0.0).then_some(story.slowest_ms);
        if let (Some(held), Some(felt)) = (&held, &felt) {
            note_pose(&mut record, held, start, felt);
        }
        Ok(record)
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
        choose(executive, &self.world.hand, &held, &start.objects[1], candidates, sigma)?
            .ok_or_else(|| anyhow::anyhow!("the plan of {} has no second grasp", start.objects[1].name))
    }

    /// The candidates whose grasp the arm reaches, if need be turned about the vertical.
    fn within_reach(&self, candidates: &[Candidate], seen: &Percept, object: &ObjectModel) -> Vec<Candidate> {
        let turned = |candidate: &Candidate| {
            let grasp = self.turned_into_reach(&candidate.grasp, seen, object)?;
            Some(Candidate { grasp, ..candidate.clone() })
        };
        candidates.iter().filter_map(turned).collect()
    }

    /// `grasp`, or one that comes from another side: what looks the same from there is grasped the same way. `None` if the arm
    /// reaches none of them.
    fn turned_into_reach(&self, grasp: &Grasp, seen: &Percept, object: &ObjectModel) -> Option<Grasp> {
        let turns: &[f64] = if object.round_about_vertical(&seen.rotation) { &TURNS } else { &TURNS[..1] };
        turns.iter().map(|turn| Grasp { yaw: grasp.yaw + turn, ..grasp.clone() }).find(|grasp| {
            let target = grasp.palm_pose(&seen.position, seen.yaw);
            self.world.posture(&target, &self.world.ready).is_ok()
        })
    }

    /// Prior perception looks at object `index` anew, with an error of its own.
    fn seen(&self, run: &mut Run, start: &Start, index: usize, rng: &mut ChaCha8Rng) -> Result<Percept> {
        let noise = TrialNoise::draw(&self.world.scenario.noise, rng).objects[index];
        Ok(percept(&start.objects[index], &run.snapshot.robot.look(index, &noise)?))
    }

    fn look_at_second(&self, run: &mut Run, start: &Start, rng: &mut ChaCha8Rng) -> Result<()> {
        let seen = self.seen(run, start, 1, rng)?;
        run.snapshot.executive.see_second(seen);
        Ok(())
    }

    fn first_again(&self, run: &mut Run, start: &Start, rng: &mut ChaCha8Rng) -> Result<()> {
        let seen = self.seen(run, start, 0, rng)?;
        self.look_at_second(run, start, rng)?;
        let planned = &run.snapshot.executive.first().0;
        let grasp = self
            .turned_into_reach(planned, &seen, &start.objects[0])
            .with_context(|| format!("{} lies out of reach", start.objects[0].name))?;
        Ok(run.snapshot.executive.retry_first(grasp, seen)?)
    }
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
