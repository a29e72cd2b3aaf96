//! Drift of the cameras: lamps and exposure warm up, so that a frame is not as bright as the background that was taken before.

/// s in a minute.
const MINUTE: f64 = 60.0;

/// How the brightness of each camera changes with time. Zero is the time at which the robot was started.
#[derive(Debug, Clone, PartialEq)]
pub struct Drift {
    /// Share of the brightness a minute, one a camera.
    rates: Vec<f64>,
    /// How long before time zero the background was taken, s.
    background_age: f64,
}

impl Drift {
    /// Cameras whose brightness changes by `rates` (share a minute) since the background was taken, `background_age` (s) before
    /// time zero.
    pub fn new(rates: Vec<f64>, background_age: f64) -> Self {
        Self { rates, background_age }
    }

    /// Brightness of `camera` at `time` (s) over that of its background.
    pub fn brightness(&self, camera: usize, time: f64) -> f32 {
        let rate = self.rates.get(camera).copied().unwrap_or(0.0);
        (1.0 + rate * (time + self.background_age) / MINUTE) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_is_that_of_the_background_at_first_and_changes_at_its_rate() {
        let drift = Drift::new(vec![0.02, -0.01], 30.0);
        assert_eq!([0, 1, 2].map(|camera| drift.brightness(camera, -30.0)), [1.0; 3]);
        assert_eq!(drift.brightness(0, 30.0), 1.02);
        assert_eq!(drift.brightness(1, 90.0), 0.98);
        assert_eq!(drift.brightness(2, 90.0), 1.0, "a camera without a rate does not drift");
    }
}
