//! Calculated duration of a cycle on the line.
//!
//! A byte is ten bits (8N1). A sync read of L bytes from N servos is 14 + N bytes out and N answers of 11 + L bytes; a
//! sync write of L bytes is 14 + N (L + 1) bytes. Before it answers, each servo waits its return delay and takes a
//! moment to turn round.

use crate::protocol2::fast_sync;

/// Bytes of a status packet besides its data.
pub const STATUS_OVERHEAD: usize = 11;
/// Bytes of a sync instruction besides ids and data.
const SYNC_OVERHEAD: usize = 14;

/// Timing of the line and of the servos on it.
///
/// ```
/// use dynamixel_bus::servo_bus::timing::{CycleTraffic, LineTiming};
///
/// // 16 servos at 1 Mbaud: position, velocity and current read, a goal position written.
/// let line = LineTiming { baud: 1_000_000, ..LineTiming::default() };
/// let cycle = CycleTraffic { servos: 16, read: 10, writes: &[4], fast: false };
/// assert!((1.0 / line.cycle(cycle) - 169.0).abs() < 1.0, "cycles a second");
/// // In one packet of all servos.
/// assert!((1.0 / line.cycle(CycleTraffic { fast: true, ..cycle }) - 205.0).abs() < 1.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineTiming {
    /// Baud rate, bits per second.
    pub baud: u32,
    /// Return delay set in the servos (register 9), s.
    pub return_delay: f64,
    /// Turnaround time of a servo beyond the return delay, s. Assumed, not published.
    pub turnaround: f64,
    /// Latency that the USB adapter adds to each request with an answer, s.
    pub usb_latency: f64,
}

impl Default for LineTiming {
    /// 3 Mbaud, no return delay, 20 us turnaround, 1 ms USB latency.
    fn default() -> Self {
        Self { baud: 3_000_000, return_delay: 0.0, turnaround: 20e-6, usb_latency: 1e-3 }
    }
}

/// A control cycle: one read from all servos and writes to all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CycleTraffic<'a> {
    /// Number of servos.
    pub servos: usize,
    /// Bytes read from each servo.
    pub read: usize,
    /// Bytes written to each servo, one entry per sync write.
    pub writes: &'a [usize],
    /// True if the read is a fast sync read.
    pub fast: bool,
}

impl LineTiming {
    /// Computes the time of `count` bytes on the line, s.
    pub fn bytes(&self, count: usize) -> f64 {
        10.0 * count as f64 / f64::from(self.baud)
    }

    /// Computes the time, s, from the first byte of a request of `request` bytes to the last byte of its answers, given
    /// their sizes in bytes; without USB latency.
    pub fn answers(&self, request: usize, answers: &[usize]) -> f64 {
        self.bytes(request + answers.iter().sum::<usize>())
            + answers.len() as f64 * (self.return_delay + self.turnaround)
    }

    /// Computes the duration of a cycle, s, including USB latency.
    pub fn cycle(&self, cycle: CycleTraffic) -> f64 {
        let request = SYNC_OVERHEAD + cycle.servos;
        let each = self.return_delay + self.turnaround;
        let read = if cycle.fast {
            self.bytes(request + fast_sync::answer_length(cycle.servos, cycle.read)) + cycle.servos as f64 * each
        } else {
            self.answers(request, &vec![STATUS_OVERHEAD + cycle.read; cycle.servos])
        };
        let write = |size: &usize| self.bytes(SYNC_OVERHEAD + cycle.servos * (size + 1));
        read + cycle.writes.iter().map(write).sum::<f64>() + self.usb_latency
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rates worked out independently for 6 servos, 10 bytes read and 4 written, without and with 1 ms of USB latency.
    #[test]
    fn known_rates() {
        let rows = [
            (57_600, false, 30.0, 29.0),
            (1_000_000, false, 495.0, 331.0),
            (2_000_000, false, 935.0, 483.0),
            (3_000_000, false, 1327.0, 570.0),
            (4_000_000, false, 1681.0, 627.0),
            (1_000_000, true, 595.0, 373.0),
            (2_000_000, true, 1111.0, 526.0),
            (3_000_000, true, 1562.0, 610.0),
            (4_000_000, true, 1961.0, 662.0),
        ];
        for (baud, fast, bare, with_usb) in rows {
            let cycle = CycleTraffic { servos: 6, read: 10, writes: &[4], fast };
            let line = LineTiming { baud, usb_latency: 0.0, ..LineTiming::default() };
            assert!((1.0 / line.cycle(cycle) - bare).abs() < 1.0, "{baud} {fast}: {}", 1.0 / line.cycle(cycle));
            let line = LineTiming { usb_latency: 1e-3, ..line };
            assert!((1.0 / line.cycle(cycle) - with_usb).abs() < 1.0, "{baud} {fast}");
        }
    }

    /// The cycle of a hand of six servos (all from present current to temperature, then goal current, then goal position) leaves
    /// time to spare at 200 Hz. With servos and adapter at their factory settings it does not.
    #[test]
    fn our_cycle_fits_200_hz_at_3_mbaud() {
        let cycle = CycleTraffic { servos: 6, read: 21, writes: &[2, 4], fast: false };
        let provisioned = LineTiming::default();
        assert!(provisioned.cycle(cycle) < 1.0 / 450.0, "{}", provisioned.cycle(cycle));
        let factory = LineTiming { return_delay: 500e-6, usb_latency: 16e-3, ..provisioned };
        let rate = 1.0 / factory.cycle(CycleTraffic { servos: 6, read: 10, writes: &[4], fast: false });
        assert!((48.0..52.0).contains(&rate), "{rate}");
    }
}
