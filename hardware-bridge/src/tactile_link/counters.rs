//! Counters of one camera.

/// So many equal images in a row are no coincidence: a live sensor's noise makes each a little different.
const FROZEN_AFTER: u32 = 4;

/// What came from one camera, and what did not.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CameraCounters {
    /// Images that became pixels.
    pub good: u64,
    /// Images that the sequence numbers say were taken and that did not come.
    pub lost: u64,
    /// Images whose data could not be decoded.
    pub undecodable: u64,
    /// Images dropped here because decoding could not keep up.
    pub overrun: u64,
    /// Times the board reported a fault of this camera.
    pub faults: u64,
    /// Capture time of the newest good image, host clock, s.
    pub newest: Option<f64>,
    last_sequence: Option<u32>,
    last_digest: u32,
    equal_run: u32,
}

impl CameraCounters {
    /// An image arrived, good or not; `digest` is of its coded data.
    pub fn note_arrival(&mut self, sequence: u32, digest: u32) {
        if let Some(last) = self.last_sequence {
            // A board that restarted begins again at a lower number: no loss to count.
            self.lost += u64::from(sequence.checked_sub(last).map_or(0, |step| step.saturating_sub(1)));
            self.equal_run = if digest == self.last_digest { self.equal_run + 1 } else { 0 };
        }
        self.last_sequence = Some(sequence);
        self.last_digest = digest;
    }

    /// An image became pixels.
    pub fn note_good(&mut self, captured: f64) {
        self.good += 1;
        self.newest = Some(self.newest.map_or(captured, |newest| newest.max(captured)));
    }

    /// Age of the newest good image at `now`, s; `None` if there never was one.
    pub fn staleness(&self, now: f64) -> Option<f64> {
        self.newest.map(|newest| now - newest)
    }

    /// Whether the camera sends the same image again and again.
    pub fn frozen(&self) -> bool {
        self.equal_run + 1 >= FROZEN_AFTER
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
            camera.note_good(f64::from(sequence));
        }
        assert_eq!((camera.good, camera.lost, camera.frozen()), (3, 2, false));
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
