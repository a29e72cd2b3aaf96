//! Bus statistics: counts and round-trip times.

use std::time::Duration;

use crate::protocol2::{Packet, PacketError, ReplyError, Status, StreamError};

/// Round trips kept for quantiles; older ones are overwritten.
const MAX_ROUND_TRIPS: usize = 16_384;

/// Counts since the bus was opened, and round-trip times.
#[derive(Debug, Clone, Default)]
pub struct BusStatistics {
    /// Requests that expect an answer.
    pub requests: u64,
    /// Sync and bulk writes, which expect none.
    pub sync_writes: u64,
    /// Good answers, one per servo.
    pub answers: u64,
    /// Answers that did not come or came damaged.
    pub missing: u64,
    /// Answers that were refusals.
    pub refused: u64,
    /// Answers of the wrong length.
    pub wrong_length: u64,
    /// Bytes between packets.
    pub garbage_bytes: u64,
    /// Packets that failed their CRC.
    pub bad_crc: u64,
    /// Packets otherwise damaged or cut short.
    pub damaged: u64,
    /// Bytes that came after their request had been given up.
    pub late_bytes: u64,
    round_trips: Vec<f32>,
}

impl BusStatistics {
    pub(super) fn note_round_trip(&mut self, took: Duration, replies: &[Result<Status, ReplyError>]) {
        let place = (self.requests as usize) % MAX_ROUND_TRIPS;
        self.requests += 1;
        if place < self.round_trips.len() {
            self.round_trips[place] = took.as_secs_f32();
        } else {
            self.round_trips.push(took.as_secs_f32());
        }
        for reply in replies {
            match reply {
                Ok(_) => self.answers += 1,
                Err(ReplyError::Missing(_)) => self.missing += 1,
                Err(ReplyError::Refused { .. }) => self.refused += 1,
                Err(ReplyError::Length { .. }) => self.wrong_length += 1,
            }
        }
    }

    pub(super) fn note_stream(&mut self, received: &[Result<Packet, StreamError>]) {
        for error in received.iter().filter_map(|packet| packet.as_ref().err()) {
            match error {
                StreamError::Garbage(count) => self.garbage_bytes += *count as u64,
                StreamError::Packet(PacketError::Crc { .. }) => self.bad_crc += 1,
                StreamError::Packet(_) | StreamError::CutShort { .. } => self.damaged += 1,
            }
        }
    }

    /// Returns the `share` quantile (0 to 1) of the last round trips, s; `None` before the first.
    pub fn round_trip(&self, share: f64) -> Option<f64> {
        let mut sorted = self.round_trips.clone();
        sorted.sort_by(f32::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        sorted.get((share * last as f64).round() as usize).map(|seconds| f64::from(*seconds))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_and_counts() {
        let mut statistics = BusStatistics::default();
        assert_eq!(statistics.round_trip(0.5), None);
        for ms in 1..=101 {
            statistics.note_round_trip(Duration::from_millis(ms), &[Err(ReplyError::Missing(1))]);
        }
        assert_eq!((statistics.requests, statistics.missing, statistics.answers), (101, 101, 0));
        assert!((statistics.round_trip(0.5).expect("some") - 0.051).abs() < 1e-6);
        assert!((statistics.round_trip(0.99).expect("some") - 0.100).abs() < 1e-6);
    }
}
