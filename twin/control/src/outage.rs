//! A robot that cannot observe or send for a while: the controller holds, and gives up once that has lasted.

use hand_model::robot::{Command, Observation, Readings, RobotError};

/// Calls in a row that may fail, one a tick: half a second of ticks.
pub const MOST_FAILURES: u32 = 60;

/// Number of failed calls of a robot in a row. While they do, a controller decides nothing: the robot keeps its last command.
#[derive(Debug, Clone, Copy, Default)]
pub struct Outage {
    observing: u32,
    sending: u32,
}

impl Outage {
    /// Notes what was observed; none while the controller has to hold.
    ///
    /// # Errors
    /// Why nothing is observed, after [`MOST_FAILURES`].
    pub fn observed(&mut self, readings: Result<Readings, RobotError>) -> Result<Option<Observation>, RobotError> {
        note(&mut self.observing, readings.and_then(Readings::complete))
    }

    /// Notes what was sent; none if nothing was.
    ///
    /// # Errors
    /// Why nothing is sent, after [`MOST_FAILURES`].
    pub fn sent(&mut self, sent: Result<Command, RobotError>) -> Result<Option<Command>, RobotError> {
        note(&mut self.sending, sent)
    }
}

fn note<T>(failures: &mut u32, called: Result<T, RobotError>) -> Result<Option<T>, RobotError> {
    match called {
        Ok(value) => {
            *failures = 0;
            Ok(Some(value))
        }
        Err(error) if *failures >= MOST_FAILURES => Err(error),
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
        let (mut outage, gone) = (Outage::default(), RobotError::Lost("nobody answers".to_owned()));
        let failed = |outage: &mut Outage| outage.observed(Err(gone.clone())).map(|seen| seen.is_some());
        for _ in 0..MOST_FAILURES {
            assert_eq!(failed(&mut outage), Ok(false));
        }
        // Sending has an outage of its own, and each begins anew after a success.
        assert_eq!(outage.sent(Err(RobotError::NotSent(0.05))), Ok(None));
        let seen = outage.observed(Ok(Observation::default().into())).expect("observed");
        assert!(seen.is_some());
        for _ in 0..MOST_FAILURES {
            assert_eq!(failed(&mut outage), Ok(false));
        }
        assert_eq!(failed(&mut outage), Err(gone.clone()));
    }

    /// What was never read is an outage too.
    #[test]
    fn incomplete_readings_are_no_observation() {
        let mut outage = Outage::default();
        assert!(outage.observed(Ok(Readings::default())).expect("borne").is_none());
    }
}
