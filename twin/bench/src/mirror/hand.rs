//! Detectors for what acts on the hand as a whole: contact, weight, and objects that are no longer there.

use std::collections::VecDeque;

use control::executive::Phase;
use grasping::Role;
use hand_model::GRAVITY;
use nalgebra::Vector3;

use super::cables::Finding;
use super::divergence::Kind;
use super::limits::HandLimits;
use super::residuals::Residuals;

/// A force that stays within this range for some ticks is at rest, N.
const STILL: f64 = 0.4;
/// Ticks in which a weight comes, and for which the force rests before.
const COMING: usize = 4;
const RESTING: usize = 11;
/// A force that changes by more within a tenth of a second pushes the hand, N.
const PUSH: f64 = 1.5;

/// What a phase lets expect of the forces on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Expects {
    /// The hand moves through the air, or stands still.
    Nothing,
    /// It meets objects, and the table.
    Contact,
}

fn expects(limits: &HandLimits, phase: Phase, progress: f64) -> Expects {
    match phase {
        Phase::ApproachFirst | Phase::ApproachSecond | Phase::ReachFirst | Phase::ReachSecond => {
            if progress < limits.arriving { Expects::Nothing } else { Expects::Contact }
        }
        Phase::LiftFirst | Phase::LiftSecond if progress > limits.leaving => Expects::Nothing,
        Phase::Begin | Phase::StepAside | Phase::Look | Phase::Decide => Expects::Nothing,
        Phase::Check | Phase::Confirm | Phase::Carry | Phase::Hold | Phase::Verify => Expects::Nothing,
        _ => Expects::Contact,
    }
}

/// How many of the two objects should be in the hand, and lifted.
fn held(limits: &HandLimits, phase: Phase, progress: f64) -> usize {
    let lifted = |before: usize| if progress > limits.leaving { before + 1 } else { before };
    match phase {
        Phase::LiftFirst => lifted(0),
        Phase::LiftSecond => lifted(1),
        Phase::Look | Phase::Decide => 1,
        phase if phase > Phase::LiftSecond => 2,
        phase if phase > Phase::Decide => 1,
        _ => 0,
    }
}

/// What is asked of the hand in a tick.
#[derive(Debug, Clone, Copy)]
pub struct HandTick<'a> {
    /// s.
    pub time: f64,
    pub phase: Phase,
    /// 0 to 1.
    pub progress: f64,
    pub residuals: &'a Residuals,
    /// Masses of the two objects as the controller knows them, kg.
    pub masses: [f64; 2],
}

/// Watches the hand.
#[derive(Debug, Clone, Default)]
pub struct HandWatch {
    /// Time (s) and force (N) of the last ticks, as long as `memory`.
    past: VecDeque<(f64, Vector3<f64>)>,
    /// Tensions in them, N.
    tensions: VecDeque<[f64; 5]>,
    /// Force on the empty hand, N.
    empty: Option<Vector3<f64>>,
    /// Weight that the hand was last felt to hold, N.
    weight: Option<f64>,
    contact_since: Option<f64>,
    payload_since: Option<f64>,
    /// When weight was last felt to come, s.
    added: Option<f64>,
    lost_since: Option<f64>,
    /// Digits that carry a load, and since when they are free, s.
    carrying: [bool; 5],
    free_since: [Option<f64>; 5],
    /// What was named and lasts: named again when it has ended.
    touching: bool,
    overloaded: bool,
    lost: usize,
    /// How many objects should have been in the hand.
    should: usize,
    /// For how many ticks the phase has expected nothing to touch the hand, and as many objects in it.
    quiet: usize,
}

/// Since when `now` has held, s: whether that is `long` enough.
fn lasts(since: &mut Option<f64>, now: bool, time: f64, long: f64) -> bool {
    if !now {
        *since = None;
        return false;
    }
    time >= *since.get_or_insert(time) + long
}

impl HandWatch {
    /// Whether something pushes the hand, or did within the last hundredths of a second.
    pub fn is_pushed(&self) -> bool {
        let newest = self.past.back().map_or_else(Vector3::zeros, |(_, force)| *force);
        self.touching || self.past.iter().rev().take(12).any(|(_, force)| (newest - force).norm() > PUSH)
    }

    /// One tick.
    pub fn see(&mut self, limits: &HandLimits, tick: &HandTick) -> Option<Finding> {
        let force = tick.residuals.force;
        let should = held(limits, tick.phase, tick.progress);
        if should < self.should {
            (self.weight, self.lost, self.overloaded) = (None, 0, false);
        }
        let quiet = expects(limits, tick.phase, tick.progress) == Expects::Nothing;
        self.quiet = if quiet && should == self.should { self.quiet + 1 } else { 0 };
        self.should = should;
        let usual = self.usual();
        self.past.push_back((tick.time, force));
        self.tensions.push_back(tick.residuals.cables.map(|cable| cable.tension));
        while self.past.front().is_some_and(|(time, _)| *time < tick.time - limits.memory) {
            self.past.pop_front();
            self.tensions.pop_front();
        }
        let moved = usual.map_or_else(Vector3::zeros, |usual| force - usual);
        let found = self
            .contact(limits, tick, &moved, quiet)
            .or_else(|| self.lost_weight(limits, tick, should, quiet))
            .or_else(|| self.lost_digits(limits, tick, should, quiet))
            .or_else(|| self.added(limits, tick, should))
            .or_else(|| self.payload(limits, tick, &moved, (should, quiet)));
        let early = tick.phase < Phase::LiftFirst && tick.progress < limits.empty[0];
        if should == 0 && quiet && early && !self.touching && moved.norm() < limits.empty[1] {
            // The empty hand's own: what the arm's model leaves out.
            let before = *self.empty.get_or_insert(force);
            self.empty = Some(before + 0.05 * (force - before));
        }
        found
    }

    /// The mean force of the last ticks, the newest two hundredths of a second left out, N.
    fn usual(&self) -> Option<Vector3<f64>> {
        let count = self.past.len().saturating_sub(3);
        (count > 3).then(|| self.past.iter().take(count).map(|(_, force)| force).sum::<Vector3<f64>>() / count as f64)
    }

    /// A force on the hand that the phase does not expect. While grasping, and of weights that come and go, only what is level counts.
    fn contact(&mut self, limits: &HandLimits, tick: &HandTick, moved: &Vector3<f64>, quiet: bool) -> Option<Finding> {
        let level = moved.xy().norm();
        let (size, least) = match quiet {
            true => (level.max(moved.z), limits.contact),
            false if level > moved.z.abs() => (level, limits.contact_level),
            false => (0.0, limits.contact_level),
        };
        let now = size > least;
        let lasts = lasts(&mut self.contact_since, now, tick.time, limits.contact_time);
        if !now {
            // It is over when the force is what it was for as long as is remembered.
            self.touching &= size > 0.3 * least;
            return None;
        }
        if !lasts || self.touching {
            return None;
        }
        self.touching = true;
        Some((Kind::UnexpectedContact, size, 0.0))
    }

    /// Whether the tension of a cable changed by so much (N) within what is remembered: digits feel an object go.
    fn let_go(&self, least_change: f64) -> bool {
        let changed = |n: usize| {
            let all = self.tensions.iter().map(|tensions| tensions[n]);
            let (least, most) = all.fold((f64::MAX, f64::MIN), |(a, b), tension| (a.min(tension), b.max(tension)));
            most - least > least_change
        };
        (0..5).any(changed)
    }

    /// Whether the force has stayed within `range` (N) for some ticks.
    fn is_steady(&self, range: f64) -> bool {
        let newest = self.past.back().map_or_else(Vector3::zeros, |(_, force)| *force);
        self.past.iter().rev().take(4).all(|(_, force)| (newest - force).norm() < range)
    }

    /// Weight on the hand now, N, where it can be told.
    fn weighs(&self, force: &Vector3<f64>) -> Option<f64> {
        self.empty.map(|empty| empty.z - force.z)
    }

    fn lost_weight(&mut self, limits: &HandLimits, tick: &HandTick, should: usize, quiet: bool) -> Option<Finding> {
        let weight = self.weighs(&tick.residuals.force).filter(|_| quiet && should > 0 && !self.touching)?;
        let had = self.weight.unwrap_or(0.0);
        let gone = had - weight;
        let single = if should == 2 { tick.masses[0].min(tick.masses[1]) } else { tick.masses[0] } * GRAVITY;
        // Of what is heavier than planned more must go.
        let single = if should == 1 || self.overloaded { single.max(had) } else { single };
        // What pushes the hand up takes more than there was.
        let pushed = gone > single + limits.lost_least || !self.is_steady(0.5 * limits.lost_least);
        let lost = gone > (limits.lost_share * single).max(limits.lost_least) && !pushed && self.let_go(limits.let_go);
        if lasts(&mut self.lost_since, lost, tick.time, limits.lost_time) {
            self.weight = Some(weight);
            self.lost += 1;
            return (self.lost <= 2).then_some((Kind::ObjectLost, weight, had));
        }
        if !lost && !pushed {
            self.weight = Some(self.weight.map_or(weight, |had| had + 0.1 * (weight - had)));
        }
        None
    }

    /// Digits that carried something and bear no more than a free digit does.
    fn lost_digits(&mut self, limits: &HandLimits, tick: &HandTick, should: usize, quiet: bool) -> Option<Finding> {
        let mut dropped = [false; 5];
        for (n, cable) in tick.residuals.cables.iter().enumerate() {
            let load = cable.tension - cable.free;
            let free = load.abs() < (limits.free_share * cable.pulled).max(0.5);
            if should == 0 {
                self.carrying[n] = false;
            } else if load > limits.carrying {
                self.carrying[n] = true;
            }
            let free = lasts(&mut self.free_since[n], free && self.carrying[n], tick.time, limits.free_time);
            if free {
                self.carrying[n] = false;
                dropped[n] = true;
            }
        }
        // An object is gone when the last of the digits that have it bears nothing.
        let gone = |role: Role| {
            let digits = role.digits().iter().map(|digit| digit.index());
            digits.clone().any(|n| dropped[n]) && !digits.clone().any(|n| self.carrying[n])
        };
        let object = [Role::First, Role::Second].into_iter().take(should).position(gone)?;
        let single = tick.masses[object] * GRAVITY;
        let whole = tick.masses[..should].iter().sum::<f64>() * GRAVITY;
        let still = self.weighs(&tick.residuals.force).filter(|_| quiet && self.is_steady(STILL));
        // Digits of the first object change their hold while the second one is raised, and it may rest in the palm.
        let moves = tick.phase == Phase::LiftSecond && !quiet;
        if moves || self.lost >= should || still.is_some_and(|weight| weight > whole - 0.5 * single) {
            return None;
        }
        self.lost += 1;
        self.weight = None;
        Some((Kind::ObjectLost, 0.0, single))
    }

    /// Weight that comes within some ticks, whatever the hand carried before. What touches the hand pushes level, too, or harder and harder.
    fn added(&mut self, limits: &HandLimits, tick: &HandTick, should: usize) -> Option<Finding> {
        let again = self.added.is_none_or(|at| tick.time > at + limits.memory);
        if should == 0 || self.touching || !again || self.quiet.min(self.past.len()) < RESTING + COMING {
            return None;
        }
        let forces: Vec<Vector3<f64>> =
            self.past.iter().skip(self.past.len() - RESTING - COMING).map(|(_, force)| *force).collect();
        let (resting, coming) = forces.split_at(RESTING);
        let (least, most) = resting.iter().fold((resting[0], resting[0]), |(a, b), force| (a.inf(force), b.sup(force)));
        let rest = resting.iter().sum::<Vector3<f64>>() / RESTING as f64;
        let down: Vec<f64> = coming.iter().map(|force| rest.z - force.z).collect();
        let step = down.iter().copied().fold(0.0, f64::max);
        let level = coming.iter().map(|force| (force - rest).xy().amax()).fold(0.0, f64::max);
        let [early, late] = limits.added_early;
        let comes = step > limits.added && down[1] > early * step && down[COMING - 1] > late * step;
        if !comes || (most - least).max() > limits.added_rest || level > limits.added_level * step {
            return None;
        }
        (self.added, self.overloaded) = (Some(tick.time), true);
        let expected = tick.masses[..should].iter().sum::<f64>();
        Some((Kind::OtherPayload, expected + step / GRAVITY, expected))
    }

    fn payload(
        &mut self,
        limits: &HandLimits,
        tick: &HandTick,
        moved: &Vector3<f64>,
        (should, quiet): (usize, bool),
    ) -> Option<Finding> {
        let weight = self.weighs(&tick.residuals.force).filter(|_| quiet && should > 0 && !self.touching)?;
        let expected = tick.masses[..should].iter().sum::<f64>();
        // What pushes pushes sideways, too.
        let more = weight - GRAVITY * expected > limits.payload && moved.xy().norm() < PUSH;
        let lasts = lasts(&mut self.payload_since, more, tick.time, limits.payload_time);
        // A weight comes and stays; what touches the hand pushes harder and harder.
        if !lasts || self.overloaded || !self.is_steady(STILL) {
            return None;
        }
        self.overloaded = true;
        Some((Kind::OtherPayload, weight / GRAVITY, expected))
    }
}

#[cfg(test)]
mod tests {
    use hand_model::Digit;

    use super::super::limits::Limits;
    use super::*;

    const TICK: f64 = 1.0 / 120.0;

    /// What is named of a hand that approaches for half a second, lifts 0.1 kg as it should, and is then loaded with `force` (N) beyond that, which
    /// comes within `ticks`; its ring finger holds the object, and goes on to if it still `grips`.
    fn named_of(force: Vector3<f64>, ticks: usize, grips: bool) -> Vec<Kind> {
        let limits = Limits::standard().expect("the limits").hand;
        let mut watch = HandWatch::default();
        let own = Vector3::new(0.4, -0.2, -1.0);
        let object = Vector3::new(0.0, 0.0, -0.1 * GRAVITY);
        let see = |n: usize| {
            let time = n as f64 * TICK;
            let come = (n.saturating_sub(179) as f64 / ticks as f64).min(1.0);
            let (phase, force) = match n {
                0..60 => (Phase::ApproachFirst, own),
                60..180 => (Phase::Look, own + object),
                _ => (Phase::Decide, own + object + come * force),
            };
            let mut residuals = Residuals { force, ..Residuals::default() };
            residuals.cables[Digit::Ring.index()].tension = if n < 60 || n >= 180 && !grips { 0.0 } else { 2.0 };
            let tick = HandTick { time, phase, progress: 0.3, residuals: &residuals, masses: [0.1, 0.2] };
            watch.see(&limits, &tick).map(|(kind, ..)| kind)
        };
        (0..240).filter_map(see).collect()
    }

    fn named(force: Vector3<f64>) -> Vec<Kind> {
        named_of(force, 1, true)
    }

    #[test]
    fn weight_that_goes_is_an_object_lost_if_a_digit_felt_it_go() {
        assert_eq!(named(Vector3::zeros()), []);
        let gone = Vector3::new(0.0, 0.0, 0.1 * GRAVITY);
        assert_eq!(named_of(gone, 1, false), [Kind::ObjectLost]);
        assert_eq!(named_of(gone, 1, true), [], "the arm's friction");
    }

    /// What comes at once is a weight, even if it is less than what both objects weigh; what comes slowly is none until it is too much for long.
    #[test]
    fn weight_that_comes_is_another_payload() {
        assert_eq!(named(Vector3::new(0.0, 0.0, -0.15 * GRAVITY)), [Kind::OtherPayload]);
        assert_eq!(named(Vector3::new(0.0, 0.0, -0.07 * GRAVITY)), [Kind::OtherPayload]);
        assert_eq!(named_of(Vector3::new(0.0, 0.0, -0.07 * GRAVITY), 20, true), []);
        assert_eq!(named_of(Vector3::new(0.0, 0.0, -0.15 * GRAVITY), 30, true), [Kind::OtherPayload]);
        assert_eq!(named(Vector3::new(0.8, 0.0, -0.07 * GRAVITY)), [], "a push");
    }

    #[test]
    fn a_push_is_a_contact() {
        assert_eq!(named(Vector3::new(8.0, 0.0, 0.0)), [Kind::UnexpectedContact]);
        assert_eq!(named(Vector3::new(1.0, 0.0, 0.0)), []);
    }
}
