//! Drift of the cameras: lamps and exposure warm up, so that a frame differs in brightness from the background, which
//! was taken earlier.

/// Length of a minute, s.
const SECONDS_PER_MINUTE: f64 = 60.0;

/// Drift of the brightness of each camera over time. Time zero is the start of the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct BrightnessDrift {
    /// Relative brightness change per minute, one per camera.
    rates: Vec<f64>,
    /// Age of the background at time zero, s.
    background_age: f64,
}

impl BrightnessDrift {
    /// Creates cameras whose brightness has changed by `rates` (relative, per minute) since the background was taken,
    /// `background_age` (s) before time zero.
    pub fn new(rates: Vec<f64>, background_age: f64) -> Self {
        Self { rates, background_age }
    }

    /// Computes the brightness of `camera` at `time` (s) relative to that of its background.
    pub fn brightness(&self, camera: usize, time: f64) -> f32 {
        let rate = self.rates.get(camera).copied().unwrap_or(0.0);
        (1.0 + rate * (time + self.background_age) / SECONDS_PER_MINUTE) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_is_that_of_the_background_at_first_and_changes_at_its_rate() {
        let drift = BrightnessDrift::new(vec![0.02, -0.01], 30.0);
        assert_eq!([0, 1, 2].map(|camera| drift.brightness(camera, -30.0)), [1.0; 3]);
        assert_eq!(drift.brightness(0, 30.0), 1.02);
        assert_eq!(drift.brightness(1, 90.0), 0.98);
        assert_eq!(drift.brightness(2, 90.0), 1.0, "a camera without a rate does not drift");
    }
}
