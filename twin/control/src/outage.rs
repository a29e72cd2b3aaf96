//! Tolerance of outages: the controller holds while the robot cannot observe or send, and gives up after a limit.

use hand_model::robot::{Observation, Readings, RobotCommand, RobotError};

/// Number of consecutive failed calls that are tolerated, at one per tick: half a second.
pub const MAX_CONSECUTIVE_FAILURES: u32 = 60;

/// Counts consecutive failed calls of a robot. Meanwhile the controller makes no decision and the robot keeps its last
/// command.
#[derive(Debug, Clone, Copy, Default)]
pub struct Outage {
    observing: u32,
    sending: u32,
}

impl Outage {
    /// Records the result of an observation; `None` while the controller has to hold.
    ///
    /// # Errors
    /// Returns the error of the observation after [`MAX_CONSECUTIVE_FAILURES`] failed calls.
    pub fn record_observation(
        &mut self,
        readings: Result<Readings, RobotError>,
    ) -> Result<Option<Observation>, RobotError> {
        count_failure(&mut self.observing, readings.and_then(Readings::into_observation))
    }

    /// Records the result of sending a command; `None` if nothing was sent.
    ///
    /// # Errors
    /// Returns the error of sending after [`MAX_CONSECUTIVE_FAILURES`] failed calls.
    pub fn record_send(&mut self, sent: Result<RobotCommand, RobotError>) -> Result<Option<RobotCommand>, RobotError> {
        count_failure(&mut self.sending, sent)
    }
}

fn count_failure<T>(failures: &mut u32, called: Result<T, RobotError>) -> Result<Option<T>, RobotError> {
    match called {
        Ok(value) => {
            *failures = 0;
            Ok(Some(value))
        }
        Err(error) if *failures >= MAX_CONSECUTIVE_FAILURES => Err(error),
        Err(_) => {
            *failures += 1;
            Ok(None)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outage_is_borne_for_a_while() {
        let (mut outage, gone) = (Outage::default(), RobotError::ConnectionLost("no answer".to_owned()));
        let failed = |outage: &mut Outage| outage.record_observation(Err(gone.clone())).map(|seen| seen.is_some());
        for _ in 0..MAX_CONSECUTIVE_FAILURES {
            assert_eq!(failed(&mut outage), Ok(false));
        }
        // Sending has a counter of its own, and each counter restarts after a success.
        assert_eq!(outage.record_send(Err(RobotError::NotSent(0.05))), Ok(None));
        let seen = outage.record_observation(Ok(Observation::default().into())).expect("observed");
        assert!(seen.is_some());
        for _ in 0..MAX_CONSECUTIVE_FAILURES {
            assert_eq!(failed(&mut outage), Ok(false));
        }
        assert_eq!(failed(&mut outage), Err(gone.clone()));
    }

    /// Readings that were never complete count as an outage too.
    #[test]
    fn incomplete_readings_are_no_observation() {
        let mut outage = Outage::default();
        assert!(outage.record_observation(Ok(Readings::default())).expect("borne").is_none());
    }
}
