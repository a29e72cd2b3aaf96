//! Counters of one camera.

/// Number of equal images in a row that marks a frozen camera: a live sensor's noise makes each a little different.
const FROZEN_RUN_LENGTH: u32 = 4;

/// Counters of the images that came from one camera, and of those that did not.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CameraCounters {
    /// Images that were decoded.
    pub decoded: u64,
    /// Images that were taken, by their sequence numbers, but did not come.
    pub lost: u64,
    /// Images whose data could not be decoded.
    pub undecodable: u64,
    /// Images dropped here because decoding could not keep up.
    pub overrun: u64,
    /// Faults of this camera that the board reported.
    pub faults: u64,
    /// Capture time of the newest good image, host clock, s.
    pub newest_capture: Option<f64>,
    last_sequence: Option<u32>,
    last_digest: u32,
    equal_run: u32,
}

impl CameraCounters {
    /// Notes the arrival of an image, good or not; `digest` is of its encoded data.
    pub fn note_arrival(&mut self, sequence: u32, digest: u32) {
        if let Some(last) = self.last_sequence {
            // A board that restarted begins again at a lower number, which is not a loss.
            self.lost += u64::from(sequence.checked_sub(last).map_or(0, |step| step.saturating_sub(1)));
            self.equal_run = if digest == self.last_digest { self.equal_run + 1 } else { 0 };
        }
        self.last_sequence = Some(sequence);
        self.last_digest = digest;
    }

    /// Notes that an image captured at `captured` (s) was decoded.
    pub fn note_decoded(&mut self, captured: f64) {
        self.decoded += 1;
        self.newest_capture = Some(self.newest_capture.map_or(captured, |newest| newest.max(captured)));
    }

    /// Returns the age of the newest good image at `now`, s; `None` if there never was one.
    pub fn staleness(&self, now: f64) -> Option<f64> {
        self.newest_capture.map(|newest| now - newest)
    }

    /// True if the camera sends the same image again and again.
    pub fn frozen(&self) -> bool {
        self.equal_run + 1 >= FROZEN_RUN_LENGTH
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_freezes_and_age() {
        let mut camera = CameraCounters::default();
        for (sequence, digest) in [(5, 1), (6, 2), (9, 3)] {
            camera.note_arrival(sequence, digest);
            camera.note_decoded(f64::from(sequence));
        }
        assert_eq!((camera.decoded, camera.lost, camera.frozen()), (3, 2, false));
        assert_eq!(camera.staleness(9.5), Some(0.5));
        for sequence in 10..13 {
            assert!(!camera.frozen());
            camera.note_arrival(sequence, 3);
        }
        assert!(camera.frozen());
        camera.note_arrival(13, 4);
        assert!(!camera.frozen());
        camera.note_arrival(0, 5);
        assert_eq!(camera.lost, 2, "a restarted board has lost nothing");
        assert_eq!(CameraCounters::default().staleness(1.0), None);
    }
}
