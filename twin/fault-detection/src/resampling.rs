//! Resampling of observations at uneven times to even ticks.
//!
//! Detectors compare one tick with the next, and the reference model moves by ticks. A simulated robot is observed at
//! each of its ticks, and its observations pass unchanged. A real robot is observed when its host has the time: some
//! milliseconds early or late, or not at all for a while. Measurements between the last observation and this one are
//! then interpolated linearly, with the command that was in force at that time.

use hand_model::ActuatorVector;
use hand_model::robot::{ArmState, RobotCommand, ServoState};

/// Tolerance of even observations, s: their interval differs from a tick by less than this.
const EVEN_TOLERANCE: f64 = 1e-6;
/// Longest interval that is interpolated, s. After a longer gap, earlier observations are invalid.
const MAX_INTERPOLATION_GAP: f64 = 0.1;
/// Maximum number of ticks for which the reference model follows the last command after a longer gap; it has settled by
/// then.
const MAX_SETTLING_TICKS: usize = 30;

/// One observation: measurements, and the command that was sent in response.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Time, s.
    pub time: f64,
    pub servos: ActuatorVector<ServoState>,
    pub arm: ArmState,
    pub sent: RobotCommand,
}

/// Result of resampling an observation.
#[derive(Debug, Clone, PartialEq)]
pub enum Resampled {
    /// The observation came exactly one tick after the one before, or is the first.
    Tick,
    /// The observation came at another time: the even ticks up to now, empty if less than one tick has passed.
    EvenTicks(Vec<Observation>),
    /// A gap: the number of ticks for which the reference model follows the last command. Earlier observations are
    /// invalid.
    Gap(usize),
}

/// Resampler of observations.
#[derive(Debug, Clone, Default)]
pub struct Resampler {
    last_observation: Option<Observation>,
    /// Time of the newest even tick, s.
    newest_tick: f64,
    /// True if observations come at uneven times.
    uneven: bool,
}

impl Resampler {
    /// True if observations have come at uneven times: measurements and reference model may then be some ticks apart.
    pub fn is_uneven(&self) -> bool {
        self.uneven
    }

    /// Takes an observation; `tick` is the length of a tick, s.
    pub fn resample(&mut self, now: &Observation, tick: f64) -> Resampled {
        let Some(last) = self.last_observation.replace(*now) else {
            self.newest_tick = now.time;
            return Resampled::Tick;
        };
        let past = now.time - last.time;
        if !self.uneven && (past - tick).abs() < EVEN_TOLERANCE {
            self.newest_tick = now.time;
            return Resampled::Tick;
        }
        self.uneven = true;
        if !(0.0..MAX_INTERPOLATION_GAP).contains(&past) {
            self.newest_tick = now.time;
            let ticks = (past / tick).max(0.0) as usize;
            return Resampled::Gap(ticks.min(MAX_SETTLING_TICKS));
        }
        let mut ticks = Vec::new();
        while self.newest_tick + tick <= now.time {
            self.newest_tick += tick;
            ticks.push(interpolate(&last, now, self.newest_tick));
        }
        Resampled::EvenTicks(ticks)
    }
}

/// Interpolates two observations at time `at` (s).
fn interpolate(last: &Observation, now: &Observation, at: f64) -> Observation {
    let share = if now.time > last.time { ((at - last.time) / (now.time - last.time)).clamp(0.0, 1.0) } else { 1.0 };
    let mix = |from: f64, to: f64| from + share * (to - from);
    let servo = |n: usize| {
        let (from, to) = (&last.servos[n], &now.servos[n]);
        ServoState {
            position: mix(from.position, to.position),
            velocity: mix(from.velocity, to.velocity),
            current: mix(from.current, to.current),
            temperature: to.temperature,
        }
    };
    let joints = |from: &[f64], to: &[f64]| from.iter().zip(to).map(|(from, to)| mix(*from, *to)).collect();
    let arm = ArmState {
        position: joints(&last.arm.position, &now.arm.position),
        velocity: joints(&last.arm.velocity, &now.arm.velocity),
        torque: joints(&last.arm.torque, &now.arm.torque),
    };
    let sent = if share < 1.0 { last.sent } else { now.sent };
    Observation { time: at, servos: (0..last.servos.len()).map(servo).collect(), arm, sent }
}

#[cfg(test)]
mod tests {
    use hand_model::robot::ServoGoal;

    use super::*;

    const TICK: f64 = 1.0 / 120.0;

    /// Returns an observation at `time` (s) of servos that turn by one radian per second.
    fn observation_at(time: f64) -> Observation {
        let servo = ServoState { position: time, velocity: 1.0, ..ServoState::default() };
        let sent = RobotCommand { arm: [time; 7].into(), servos: [ServoGoal::Current(0.0); 6].into(), capture: false };
        Observation { time, servos: [servo; 6].into(), arm: ArmState::default(), sent }
    }

    #[test]
    fn even_looks_pass_unchanged() {
        let mut pace = Resampler::default();
        for n in 0..500 {
            assert_eq!(pace.resample(&observation_at(f64::from(n) * TICK), TICK), Resampled::Tick);
        }
        assert!(!pace.is_uneven());
    }

    /// Observations that are late, early or left out make even ticks, one per elapsed tick, with the state at their
    /// times.
    #[test]
    fn uneven_looks_make_even_ticks() {
        let mut pace = Resampler::default();
        let (mut all, mut time) = (Vec::new(), 0.0);
        pace.resample(&observation_at(0.0), TICK);
        for n in 0..600 {
            time += TICK * [0.4, 1.0, 1.6, 3.2, 0.1, 1.0, 4.9][n % 7];
            let Resampled::EvenTicks(ticks) = pace.resample(&observation_at(time), TICK) else { panic!("at {time} s") };
            assert!(ticks.len() <= 6, "{}", ticks.len());
            all.extend(ticks);
        }
        assert!((all.len() as f64 * TICK - time).abs() <= TICK, "{} ticks in {time} s", all.len());
        for (n, tick) in all.iter().enumerate() {
            assert!((tick.time - (n + 1) as f64 * TICK).abs() < 1e-9);
            assert!((tick.servos[0].position - tick.time).abs() < 1e-9);
            assert!(tick.sent.arm[0] <= tick.time + 1e-9, "a command is used only after it was sent");
        }
    }

    /// Catching up after a gap takes no longer than settling, and time continues from there.
    #[test]
    fn a_gap_costs_a_bounded_number_of_ticks() {
        let mut pace = Resampler::default();
        pace.resample(&observation_at(0.0), TICK);
        assert_eq!(pace.resample(&observation_at(24.5 * TICK), TICK), Resampled::Gap(24));
        assert_eq!(pace.resample(&observation_at(40.0), TICK), Resampled::Gap(MAX_SETTLING_TICKS));
        assert!(
            matches!(pace.resample(&observation_at(40.0 + 1.5 * TICK), TICK), Resampled::EvenTicks(ticks) if ticks.len() == 1)
        );
    }
}
