//! Detectors for loads on the hand as a whole: contact, weight, and lost objects.

use std::collections::VecDeque;

use control::executor::{Phase, Skill};
use hand_model::hand::MAX_DIGITS;
use hand_model::{Digit, DigitVector, GRAVITY};
use nalgebra::Vector3;

use super::cables::Finding;
use super::expected::{ExpectedContact, expected_contact, expected_held};
use super::external_wrench::{ExternalWrench, WrenchLevel};
use super::fault::FaultKind;
use super::limits::{DetectionLimits, HandLimits};
use super::residuals::Residuals;
use super::steps::{PERSISTENCE_TICKS, ResidualStep, detect_step};

/// Range within which a force counts as steady if it stays there for some ticks, N.
const STEADY_FORCE_RANGE: f64 = 0.4;
/// Change of force within a tenth of a second that counts as a push on the hand, N.
const PUSH_FORCE_CHANGE: f64 = 1.5;
/// Upward force beyond which a loaded hand must be touching something else, too, N.
const MIN_UPWARD_PUSH: f64 = 0.5;
/// Ticks for which the force must be known before it is judged, and within which a push shows.
const MIN_KNOWN_TICKS: usize = 12;
/// Ticks over which the force is averaged to measure the weight of an object that digits have released.
const WEIGHT_AVERAGE_TICKS: usize = 4;
/// Ticks within which a jolt of the hand shows that a digit has touched something.
const JOLT_TICKS: usize = 6;
/// Contacts that follow each other within this time count as one, s.
const CONTACT_REPORT_INTERVAL: f64 = 0.3;

/// State and expectations of the hand in one tick.
#[derive(Debug, Clone, Copy)]
pub struct HandTick<'a> {
    /// Time, s.
    pub time: f64,
    pub phase: Phase,
    /// Progress of the phase, 0 to 1.
    pub progress: f64,
    pub residuals: &'a Residuals,
    /// Masses of the objects as known to the controller, kg.
    pub masses: &'a [f64],
    /// Digits that grasp each of the objects.
    pub digits: &'a [&'a [Digit]],
}

/// Detector for the hand.
#[derive(Debug, Clone, Default)]
pub struct HandWatch {
    /// Time (s) and force (N) of the last ticks, over the span `memory` ([`HandLimits`]).
    past: VecDeque<(f64, Vector3<f64>)>,
    /// Cable tensions in the same ticks, N.
    tensions: VecDeque<DigitVector>,
    /// Force bias: force measured on the empty hand, N.
    force_bias: Option<Vector3<f64>>,
    /// Weight last measured in the hand, N.
    weight: Option<f64>,
    contact_since: Option<f64>,
    payload_since: Option<f64>,
    /// Time of the last sudden change of weight, s.
    last_weight_step: Option<f64>,
    /// Excess weight in the hand since then, N.
    excess_weight: f64,
    lost_since: Option<f64>,
    /// Object that its digits have released, and the time, s.
    released: Option<(usize, f64)>,
    /// Digits that carry a load.
    carrying: [bool; MAX_DIGITS],
    /// Times since which digits have been free, s.
    free_since: [Option<f64>; MAX_DIGITS],
    /// True while a reported contact lasts: it is reported again only after it has ended.
    contact_reported: bool,
    /// Time of the last report of a contact, s: see [`CONTACT_REPORT_INTERVAL`].
    last_contact: Option<f64>,
    overloaded: bool,
    lost: usize,
    /// Number of objects that should have been in the hand in the last tick.
    expected_held: usize,
    /// True if the phase expects contact.
    expects_contact: bool,
}

/// Updates `since`, the time since which `now` has been true, s. Returns true if that is at least `long` (s).
fn has_lasted(since: &mut Option<f64>, now: bool, time: f64, long: f64) -> bool {
    if !now {
        *since = None;
        return false;
    }
    time >= *since.get_or_insert(time) + long
}

impl HandWatch {
    /// Returns the external wrench on the hand now, or within the last hundredths of a second.
    pub fn external_wrench(&self, limits: &HandLimits) -> ExternalWrench {
        let newest = self.past.iter().rev().take(JOLT_TICKS).map(|(_, force)| force);
        let changes = newest.clone().zip(newest.skip(1)).map(|(one, other)| (one - other).norm());
        let jolt = if self.expects_contact { changes.fold(0.0, f64::max) } else { 0.0 };
        ExternalWrench { level: self.wrench_level(limits), jolt }
    }

    fn wrench_level(&self, limits: &HandLimits) -> WrenchLevel {
        let newest = self.past.back().map_or_else(Vector3::zeros, |(_, force)| *force);
        let empty = self.force_bias.unwrap_or_else(Vector3::zeros);
        // Conservative: a hand of unknown load counts as strongly pushed.
        if self.past.len() < MIN_KNOWN_TICKS || self.past.iter().any(|(_, force)| (force - empty).norm() > limits.hard)
        {
            return WrenchLevel::Strong;
        }
        let changes =
            self.past.iter().rev().take(MIN_KNOWN_TICKS).any(|(_, force)| (newest - force).norm() > PUSH_FORCE_CHANGE);
        if self.contact_reported || changes { WrenchLevel::Moderate } else { WrenchLevel::Absent }
    }

    /// Skips a tick in which the forces on the hand are unknown because a joint of the arm is on its stop.
    pub fn skip_tick(&mut self) {
        self.past.clear();
        self.tensions.clear();
        (self.contact_since, self.payload_since, self.lost_since) = (None, None, None);
        self.contact_reported = false;
    }

    /// Processes one tick.
    pub fn update(&mut self, all: &DetectionLimits, tick: &HandTick) -> Option<Finding> {
        let limits = &all.hand;
        let force = tick.residuals.force;
        let should = expected_held(limits, tick.phase, tick.progress, tick.masses.len());
        if should < self.expected_held {
            (self.weight, self.lost, self.overloaded, self.excess_weight) = (None, 0, false, 0.0);
        }
        let quiet = expected_contact(limits, tick.phase, tick.progress) == ExpectedContact::NoContact;
        (self.expected_held, self.expects_contact) = (should, !quiet);
        let usual = self.mean_force();
        self.past.push_back((tick.time, force));
        self.tensions.push_back(tick.residuals.cables.iter().map(|cable| cable.tension).collect());
        while self.past.front().is_some_and(|(time, _)| *time < tick.time - limits.memory) {
            self.past.pop_front();
            self.tensions.pop_front();
        }
        let moved = usual.map_or_else(Vector3::zeros, |usual| force - usual);
        let found = self
            .detect_contact(limits, tick, &moved, quiet)
            .or_else(|| self.detect_lost_weight(limits, tick, should, quiet))
            .or_else(|| self.detect_lost_digits(limits, tick, should, quiet))
            .or_else(|| self.detect_weight_step(all, tick, should, quiet))
            .or_else(|| self.detect_payload(limits, tick, &moved, (should, quiet)));
        let early = !tick.phase.has_begun_lift(0) && tick.progress < limits.empty[0];
        if should == 0 && quiet && early && !self.contact_reported && moved.norm() < limits.empty[1] {
            // Tracks the bias of the empty hand, that is, errors of the arm's model.
            let before = *self.force_bias.get_or_insert(force);
            self.force_bias = Some(before + 0.05 * (force - before));
        }
        found
    }

    /// Returns the mean force of the last ticks without the newest two hundredths of a second, N.
    fn mean_force(&self) -> Option<Vector3<f64>> {
        let count = self.past.len().saturating_sub(3);
        (count > 3).then(|| self.past.iter().take(count).map(|(_, force)| force).sum::<Vector3<f64>>() / count as f64)
    }

    /// Detects a force on the hand that the phase does not expect. During grasping, and while weights change, only the
    /// horizontal component counts.
    fn detect_contact(
        &mut self,
        limits: &HandLimits,
        tick: &HandTick,
        moved: &Vector3<f64>,
        quiet: bool,
    ) -> Option<Finding> {
        let level = moved.xy().norm();
        let (size, least) = match quiet {
            true => (level.max(moved.z), limits.contact),
            false if level > moved.z.abs() => (level, limits.contact_level),
            false => (0.0, limits.contact_level),
        };
        let now = size > least;
        let lasts = has_lasted(&mut self.contact_since, now, tick.time, limits.contact_time);
        if !now {
            // A contact is over once the force is back to its mean over the remembered span.
            self.contact_reported &= size > 0.3 * least;
            return None;
        }
        if !lasts || self.contact_reported {
            return None;
        }
        self.contact_reported = true;
        let again =
            self.last_contact.replace(tick.time).is_some_and(|before| tick.time < before + CONTACT_REPORT_INTERVAL);
        (!again).then_some((FaultKind::UnexpectedContact, size, 0.0))
    }

    /// True if the tension of a cable of the `holding` digits changed by more than `least_change` (N) within the
    /// remembered span, as it does when an object leaves.
    fn tension_changed(&self, least_change: f64, holding: &[&[Digit]]) -> bool {
        let changed = |n: usize| {
            let all = self.tensions.iter().map(|tensions| tensions[n]);
            let (least, most) = all.fold((f64::MAX, f64::MIN), |(a, b), tension| (a.min(tension), b.max(tension)));
            most - least > least_change
        };
        holding.iter().copied().flatten().map(|digit| digit.index()).any(changed)
    }

    /// True if the force has stayed within `range` (N) for some ticks.
    fn is_steady(&self, range: f64) -> bool {
        let newest = self.past.back().map_or_else(Vector3::zeros, |(_, force)| *force);
        self.past.iter().rev().take(4).all(|(_, force)| (newest - force).norm() < range)
    }

    /// Returns the mean force of the newest `count` ticks, N.
    fn newest_mean(&self, count: usize) -> Vector3<f64> {
        let newest = self.past.iter().rev().take(count).map(|(_, force)| force);
        newest.sum::<Vector3<f64>>() / self.past.len().clamp(1, count) as f64
    }

    /// Returns the present weight on the hand, N, or `None` if the force bias is unknown.
    fn measured_weight(&self, force: &Vector3<f64>) -> Option<f64> {
        self.force_bias.map(|empty| empty.z - force.z)
    }

    fn detect_lost_weight(
        &mut self,
        limits: &HandLimits,
        tick: &HandTick,
        should: usize,
        quiet: bool,
    ) -> Option<Finding> {
        let weight =
            self.measured_weight(&tick.residuals.force).filter(|_| quiet && should > 0 && !self.contact_reported)?;
        let had = self.weight.unwrap_or(0.0);
        let gone = had - weight;
        let single = tick.masses[..should].iter().copied().fold(f64::INFINITY, f64::min) * GRAVITY;
        // If the load is heavier than planned, more weight must vanish.
        let single = if should == 1 || self.overloaded { single.max(had) } else { single };
        // A drop by more than the previous weight is an upward push.
        let pushed = gone > single + limits.lost_least || !self.is_steady(0.5 * limits.lost_least);
        let lost = gone > (limits.lost_share * single).max(limits.lost_least)
            && !pushed
            && self.tension_changed(limits.let_go, &tick.digits[..should]);
        if has_lasted(&mut self.lost_since, lost, tick.time, limits.lost_time) {
            self.weight = Some(weight);
            self.lost += 1;
            return (self.lost <= 2).then_some((FaultKind::ObjectLost, weight, had));
        }
        if !lost && !pushed {
            self.weight = Some(self.weight.map_or(weight, |had| had + 0.1 * (weight - had)));
        }
        None
    }

    /// Detects digits that carried something and now bear no more load than a free digit.
    fn detect_lost_digits(
        &mut self,
        limits: &HandLimits,
        tick: &HandTick,
        should: usize,
        quiet: bool,
    ) -> Option<Finding> {
        let mut dropped = [false; MAX_DIGITS];
        for (n, cable) in tick.residuals.cables.iter().enumerate() {
            let load = cable.tension - cable.reference_tension;
            let free = load.abs() < (limits.free_share * cable.servo_tension).max(0.5);
            if should == 0 {
                self.carrying[n] = false;
            } else if load > limits.carrying {
                self.carrying[n] = true;
            }
            let free = has_lasted(&mut self.free_since[n], free && self.carrying[n], tick.time, limits.free_time);
            if free {
                self.carrying[n] = false;
                dropped[n] = true;
            }
        }
        // An object is lost when the last of its digits bears nothing.
        let gone = |digits: &&[Digit]| {
            let digits = digits.iter().map(|digit| digit.index());
            digits.clone().any(|n| dropped[n]) && !digits.clone().any(|n| self.carrying[n])
        };
        let dropped = tick.digits[..should].iter().position(gone);
        // Digits of a held object change their grip while the next object is raised.
        let moves = tick.phase.skill == Skill::Lift && tick.phase.object > 0 && !quiet;
        self.released = dropped.filter(|_| !moves).map(|object| (object, tick.time)).or(self.released);
        let (object, since) = self.released?;
        let single = tick.masses.get(object)? * GRAVITY;
        let whole = tick.masses[..should].iter().sum::<f64>() * GRAVITY;
        // The object may rest in the palm, or be caught again.
        let weight = self.measured_weight(&self.newest_mean(WEIGHT_AVERAGE_TICKS)).filter(|_| quiet);
        if self.lost >= should || object >= should || weight.is_some_and(|weight| weight > whole - 0.5 * single) {
            self.released = None;
            return None;
        }
        if weight.is_some() && tick.time < since + limits.gone_time {
            return None;
        }
        self.released = None;
        self.lost += 1;
        self.weight = None;
        Some((FaultKind::ObjectLost, 0.0, single))
    }

    /// Detects weight that appears or vanishes suddenly, whatever the hand carried before.
    fn detect_weight_step(
        &mut self,
        limits: &DetectionLimits,
        tick: &HandTick,
        should: usize,
        quiet: bool,
    ) -> Option<Finding> {
        let again = self.last_weight_step.is_none_or(|at| tick.time > at + limits.hand.memory);
        let stayed = detect_step(&self.past, &limits.step, !quiet, PERSISTENCE_TICKS);
        // A heavy object may fall out before its weight has stayed.
        let comes = |step: &ResidualStep| step.weight > 0.0 && quiet;
        let step = stayed.or_else(|| detect_step(&self.past, &limits.step, !quiet, 0).filter(comes));
        let step = step.filter(|_| should > 0 && again && !self.contact_reported)?;
        let expected = tick.masses[..should].iter().sum::<f64>();
        let pushed_up = self.force_bias.is_some_and(|empty| step.before.z > empty.z + MIN_UPWARD_PUSH);
        if step.weight < 0.0 {
            // An obstacle under the arriving hand pushes it up.
            let arrives = !quiet && tick.phase.skill != Skill::Lift && tick.phase != Phase::run(Skill::Grasp, 1);
            let most = limits.step.most * GRAVITY * expected + self.excess_weight;
            if self.lost >= should || arrives || pushed_up || -step.weight > most {
                return None;
            }
            (self.last_weight_step, self.weight) = (Some(tick.time), None);
            self.lost += 1;
            return Some((FaultKind::ObjectLost, GRAVITY * expected + step.weight, GRAVITY * expected));
        }
        if pushed_up || !quiet && step.weight > limits.step.heaviest {
            return None;
        }
        (self.last_weight_step, self.overloaded) = (Some(tick.time), true);
        self.excess_weight += step.weight;
        Some((FaultKind::OtherPayload, expected + step.weight / GRAVITY, expected))
    }

    fn detect_payload(
        &mut self,
        limits: &HandLimits,
        tick: &HandTick,
        moved: &Vector3<f64>,
        (should, quiet): (usize, bool),
    ) -> Option<Finding> {
        let weight =
            self.measured_weight(&tick.residuals.force).filter(|_| quiet && should > 0 && !self.contact_reported)?;
        let expected = tick.masses[..should].iter().sum::<f64>();
        // Weight is measured only where the object was raised: elsewhere the arm's own errors differ. A push also acts
        // sideways.
        let raised = matches!(tick.phase.skill, Skill::Lift | Skill::Snapshot);
        let more = raised && weight - GRAVITY * expected > limits.payload && moved.xy().norm() < PUSH_FORCE_CHANGE;
        let lasts = has_lasted(&mut self.payload_since, more, tick.time, limits.payload_time);
        // A weight appears and stays, whereas a contact force keeps growing.
        if !lasts || self.overloaded || !self.is_steady(STEADY_FORCE_RANGE) {
            return None;
        }
        self.overloaded = true;
        Some((FaultKind::OtherPayload, weight / GRAVITY, expected))
    }
}

#[cfg(test)]
mod tests {
    use hand_model::Digit;

    use super::super::residuals::CableState;
    use super::*;

    const ROLES: [&[Digit]; 2] = [&[Digit::Ring, Digit::Little], &[Digit::Thumb, Digit::Index, Digit::Middle]];

    const TICK: f64 = 1.0 / 120.0;

    /// Returns the findings for a hand that approaches for half a second, lifts 0.1 kg as expected, and then bears an
    /// additional `force` (N), which builds up within `ticks`. Its ring finger holds the object, and still does so
    /// afterwards if it `grips`. The arm's torques follow with their lag.
    fn detected_faults_for(force: Vector3<f64>, ticks: usize, grips: bool) -> Vec<FaultKind> {
        let limits = DetectionLimits::standard().expect("the limits");
        let mut watch = HandWatch::default();
        let own = Vector3::new(0.4, -0.2, -1.0);
        let object = Vector3::new(0.0, 0.0, -0.1 * GRAVITY);
        let mut felt = own;
        let see = |n: usize| {
            let time = n as f64 * TICK;
            let share = |from: usize, ticks: usize| (n.saturating_sub(from) as f64 / ticks as f64).min(1.0);
            let (phase, progress) = match n {
                0..60 => (Phase::run(Skill::Approach, 0), 0.3),
                60..120 => (Phase::run(Skill::Lift, 0), share(60, 60)),
                120..180 => (Phase::run(Skill::Snapshot, 0), 0.3),
                _ => (Phase::decide(Skill::Snapshot, 0), 0.3),
            };
            let acts = own + share(60, 30) * object + share(179, ticks) * force;
            felt = acts + limits.step.lag * (felt - acts);
            let mut residuals = Residuals { force: felt, cables: [CableState::default(); 5].into() };
            residuals.cables[Digit::Ring.index()].tension = if n < 60 || n >= 180 && !grips { 0.0 } else { 2.0 };
            let tick = HandTick { time, phase, progress, residuals: &residuals, masses: &[0.1, 0.2], digits: &ROLES };
            watch.update(&limits, &tick).map(|(kind, ..)| kind)
        };
        (0..240).filter_map(see).collect()
    }

    fn detected_faults(force: Vector3<f64>) -> Vec<FaultKind> {
        detected_faults_for(force, 1, true)
    }

    #[test]
    fn weight_that_goes_is_an_object_lost_if_it_goes_at_once_or_a_digit_felt_it_go() {
        assert_eq!(detected_faults(Vector3::zeros()), []);
        let gone = Vector3::new(0.0, 0.0, 0.1 * GRAVITY);
        assert_eq!(detected_faults_for(gone, 1, false), [FaultKind::ObjectLost]);
        assert_eq!(detected_faults_for(gone, 1, true), [FaultKind::ObjectLost], "a load gone at once is weight");
        assert_eq!(detected_faults_for(gone, 20, true), [], "the arm's friction");
    }

    /// A sudden load is a weight, even if less than that of both objects. A slow load is none until it is too large for
    /// too long.
    #[test]
    fn weight_that_comes_is_another_payload() {
        assert_eq!(detected_faults(Vector3::new(0.0, 0.0, -0.15 * GRAVITY)), [FaultKind::OtherPayload]);
        assert_eq!(detected_faults(Vector3::new(0.0, 0.0, -0.1 * GRAVITY)), [FaultKind::OtherPayload]);
        assert_eq!(detected_faults_for(Vector3::new(0.0, 0.0, -0.07 * GRAVITY), 20, true), []);
        assert_eq!(detected_faults_for(Vector3::new(0.0, 0.0, -0.15 * GRAVITY), 30, true), [FaultKind::OtherPayload]);
    }

    #[test]
    fn a_push_is_a_contact() {
        assert_eq!(detected_faults(Vector3::new(8.0, 0.0, 0.0)), [FaultKind::UnexpectedContact]);
        assert_eq!(detected_faults(Vector3::new(1.0, 0.0, 0.0)), []);
    }
}
