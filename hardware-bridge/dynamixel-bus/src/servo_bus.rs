//! Host side of the servo bus: requests, and answers that arrive before a deadline or count as missing.
//!
//! A [`ServoBus`] owns the serial port. A call that concerns one servo fails with that servo's [`BusError`]. A call
//! that concerns several returns a result for each of them ([`ReplyError`]), so that a silent servo does not hide the
//! others. There are no retries: the next control cycle asks again.
//!
//! [`timing`] calculates the duration of a cycle, [`statistics`] measures it, [`latency_timer`] reads the delay of the
//! USB adapter.

pub mod latency_timer;
pub mod statistics;
pub mod timing;

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serial2::SerialPort;
use statistics::BusStatistics;
use timing::LineTiming;

use crate::exclusive;
use crate::protocol2::error::InstructionError;
use crate::protocol2::{
    BROADCAST_ID, Decoder, Instruction, Packet, ReplyError, Status, StreamError, fast_sync, sync_read_replies,
};
use crate::register::{Register, RegisterError};
use crate::tap::{Direction, Tap};
use crate::xc330;

/// Error of an operation on the bus.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The port cannot be opened, read or written.
    #[error("{port}: {}", describe_port_error(.source))]
    Port {
        /// Device path.
        port: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The request does not fit a packet.
    #[error(transparent)]
    Request(#[from] InstructionError),
    /// There is no usable answer.
    #[error(transparent)]
    Reply(#[from] ReplyError),
    /// The value does not fit its register.
    #[error("servo {id}: {source}")]
    Register {
        /// Id of the servo.
        id: u8,
        /// Error of the value.
        source: RegisterError,
    },
    /// The register does not hold the value that was written.
    #[error("servo {id}: {register}: read back {found}, expected {expected}")]
    ReadBack {
        /// Id of the servo.
        id: u8,
        register: &'static str,
        found: f64,
        expected: f64,
    },
}

/// Describes an operating system's error of a port, with advice where the error alone is no help.
fn describe_port_error(error: &std::io::Error) -> String {
    // A hung-up terminal reads as end of file, or as an input/output error.
    const EIO: i32 = 5;
    let gone = error.kind() == ErrorKind::UnexpectedEof || error.raw_os_error() == Some(EIO);
    if gone { format!("the port is gone; check the USB cable and the adapter ({error})") } else { error.to_string() }
}

/// Settings of a bus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BusSettings {
    /// Baud rate, bits per second.
    pub baud: u32,
    /// Return delay set in the servos, s.
    pub return_delay: f64,
    /// Time-out of an answer beyond its time on the line, s: covers the latency of the USB adapter and of the operating
    /// system.
    pub slack: f64,
}

impl Default for BusSettings {
    /// 3 Mbaud, no return delay, and 20 ms of slack, which covers an adapter left at its 16 ms latency timer.
    fn default() -> Self {
        Self { baud: 3_000_000, return_delay: 0.0, slack: 0.020 }
    }
}

/// Answer of a servo to a ping.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PingReply {
    pub id: u8,
    /// Model number; the key of [`crate::models::Model::by_number`].
    pub model: u16,
    /// Firmware version.
    pub firmware: u8,
}

/// An open servo bus.
#[derive(Debug)]
pub struct ServoBus {
    port: SerialPort,
    path: PathBuf,
    settings: BusSettings,
    decoder: Decoder,
    statistics: BusStatistics,
    tap: Option<Tap>,
}

impl ServoBus {
    /// Opens the port in raw mode, 8N1, for exclusive use.
    pub fn open(path: &Path, settings: BusSettings) -> Result<Self, BusError> {
        let failed = |source| BusError::Port { port: path.to_owned(), source };
        let port = exclusive::open(path, settings.baud).map_err(failed)?;
        Ok(Self {
            port,
            path: path.to_owned(),
            settings,
            decoder: Decoder::default(),
            statistics: BusStatistics::default(),
            tap: None,
        })
    }

    /// Copies every byte that crosses the bus from now on to `tap`.
    pub fn tap(&mut self, tap: Tap) {
        self.tap = Some(tap);
    }

    /// Returns the bus statistics so far.
    pub fn statistics(&self) -> &BusStatistics {
        &self.statistics
    }

    /// Returns the settings of the bus.
    pub fn settings(&self) -> BusSettings {
        self.settings
    }

    /// Sets the time-out of an answer beyond its time on the line, s.
    pub fn set_slack(&mut self, seconds: f64) {
        self.settings.slack = seconds;
    }

    /// Pings servo `id`.
    pub fn ping(&mut self, id: u8) -> Result<PingReply, BusError> {
        let status = self.ask_one(id, &Instruction::Ping, 3)?;
        ping_reply(&status).ok_or(BusError::Reply(ReplyError::Missing(id)))
    }

    /// Pings all servos at once and collects answers for `reply_timeout`; sorted by id.
    pub fn scan(&mut self, reply_timeout: Duration) -> Result<Vec<PingReply>, BusError> {
        let wire = Instruction::Ping.encode(BROADCAST_ID)?;
        let deadline = self.transmit(&wire)? + reply_timeout;
        let mut received = Vec::new();
        while Instant::now() < deadline {
            self.receive(deadline, &mut received)?;
        }
        self.decoder.push(&received);
        let packets = self.decoder.time_out();
        self.statistics.note_stream(&packets);
        let mut found: Vec<PingReply> =
            packets.iter().flatten().filter_map(Status::decode).filter_map(|status| ping_reply(&status)).collect();
        found.sort_by_key(|pinged| pinged.id);
        Ok(found)
    }

    /// Reads `length` bytes from `address` on from one servo.
    pub fn read_block(&mut self, id: u8, address: u16, length: u16) -> Result<Status, BusError> {
        self.ask_one(id, &Instruction::Read { address, length }, length.into())
    }

    /// Reads a register, as a value in SI.
    pub fn read(&mut self, id: u8, register: &Register) -> Result<f64, BusError> {
        let length = u16::from(register.size);
        let status = self.ask_one(id, &Instruction::Read { address: register.address, length }, length.into())?;
        register.read(&status.data).map_err(|source| BusError::Register { id, source })
    }

    /// Writes a value in SI and waits for the servo's acknowledgement.
    pub fn write(&mut self, id: u8, register: &Register, si: f64) -> Result<(), BusError> {
        let data = register.write(si).map_err(|source| BusError::Register { id, source })?;
        self.ask_one(id, &Instruction::Write { address: register.address, data }, 0)?;
        Ok(())
    }

    /// Verifies that a register holds `expected`, to within its resolution.
    pub fn expect(&mut self, id: u8, register: &Register, expected: f64) -> Result<(), BusError> {
        let found = self.read(id, register)?;
        if register.holds(found, expected) {
            return Ok(());
        }
        Err(BusError::ReadBack { id, register: register.name, found, expected })
    }

    /// Restarts a servo. This ends a shutdown, but loses the torque and everything in RAM. The servo is off the bus for
    /// about a third of a second.
    pub fn reboot(&mut self, id: u8) -> Result<(), BusError> {
        self.ask_one(id, &Instruction::Reboot, 0)?;
        Ok(())
    }

    /// Reads `length` bytes from `address` on from each of `ids`.
    pub fn sync_read(
        &mut self,
        ids: &[u8],
        address: u16,
        length: u16,
    ) -> Result<Vec<Result<Status, ReplyError>>, BusError> {
        let request = Instruction::SyncRead { address, length, ids: ids.to_vec() };
        let sizes = vec![usize::from(length); ids.len()];
        let (received, took) = self.exchange(BROADCAST_ID, &request, &sizes)?;
        let replies = sync_read_replies(ids, length.into(), received);
        self.statistics.note_round_trip(took, &replies);
        Ok(replies)
    }

    /// Like [`Self::sync_read`], but answered in one packet; needs firmware 46 or later in all servos.
    pub fn fast_sync_read(
        &mut self,
        ids: &[u8],
        address: u16,
        length: u16,
    ) -> Result<Vec<Result<Status, ReplyError>>, BusError> {
        let request = Instruction::FastSyncRead { address, length, ids: ids.to_vec() };
        let expected = fast_sync::answer_length(ids.len(), length.into());
        let wire = request.encode(BROADCAST_ID)?;
        let started = self.transmit(&wire)?;
        let timing = self.timing();
        let turns = ids.len() as f64 * (timing.return_delay + timing.turnaround);
        let deadline = started + self.reply_timeout(timing.answers(wire.len(), &[expected]) + turns);
        let mut received = Vec::with_capacity(expected);
        let mut replies = Vec::new();
        // Enough bytes may have garbage before the answer and still lack its end.
        while self.receive(deadline, &mut received)? {
            if received.len() >= expected {
                replies = fast_sync::replies(ids, length.into(), &received);
                if replies.iter().all(Result::is_ok) {
                    break;
                }
            }
        }
        if replies.is_empty() {
            replies = fast_sync::replies(ids, length.into(), &received);
        }
        self.statistics.note_round_trip(started.elapsed(), &replies);
        Ok(replies)
    }

    /// Writes the same registers in several servos at once. There is no answer: a refused value is lost silently.
    pub fn sync_write(&mut self, address: u16, length: u16, data: Vec<(u8, Vec<u8>)>) -> Result<(), BusError> {
        let wire = Instruction::SyncWrite { address, length, data }.encode(BROADCAST_ID)?;
        self.transmit(&wire)?;
        self.statistics.sync_writes += 1;
        Ok(())
    }

    /// Writes the same value (SI) to one register of all `ids`. There is no answer.
    pub fn sync_write_register(&mut self, ids: &[u8], register: &Register, si: f64) -> Result<(), BusError> {
        let bytes = register.write(si).map_err(|source| BusError::Register { id: BROADCAST_ID, source })?;
        let data = ids.iter().map(|id| (*id, bytes.clone())).collect();
        self.sync_write(register.address, register.size.into(), data)
    }

    /// Switches the torque of all `ids` on or off, one by one; a failure does not stop the others.
    pub fn set_torque(&mut self, ids: &[u8], on: bool) -> Vec<Result<(), BusError>> {
        let value = f64::from(u8::from(on));
        ids.iter().map(|id| self.write(*id, &xc330::TORQUE_ENABLE, value)).collect()
    }

    /// Returns the timing of the line at the bus's settings.
    pub fn timing(&self) -> LineTiming {
        LineTiming { baud: self.settings.baud, return_delay: self.settings.return_delay, ..LineTiming::default() }
    }

    fn ask_one(&mut self, id: u8, request: &Instruction, length: usize) -> Result<Status, BusError> {
        let (received, took) = self.exchange(id, request, &[length])?;
        let reply = sync_read_replies(&[id], length, received).pop().unwrap_or(Err(ReplyError::Missing(id)));
        self.statistics.note_round_trip(took, std::slice::from_ref(&reply));
        Ok(reply?)
    }

    /// Sends a request, then collects packets until as many answers of the given data sizes have come as were
    /// requested, or the time is up.
    fn exchange(
        &mut self,
        id: u8,
        request: &Instruction,
        sizes: &[usize],
    ) -> Result<(Vec<Result<Packet, StreamError>>, Duration), BusError> {
        let wire = request.encode(id)?;
        let started = self.transmit(&wire)?;
        let bytes: Vec<usize> = sizes.iter().map(|size| timing::STATUS_OVERHEAD + size).collect();
        let deadline = started + self.reply_timeout(self.timing().answers(wire.len(), &bytes));
        let mut packets: Vec<Result<Packet, StreamError>> = Vec::new();
        let mut chunk = Vec::new();
        // An answer of another size belongs to an earlier request and came after this one was sent.
        let answers_this = |status: &Status| status.error.is_some() || sizes.contains(&status.data.len());
        loop {
            let statuses = packets.iter().flatten().filter_map(Status::decode);
            let answers = statuses.filter(answers_this).count();
            if answers >= sizes.len() {
                break;
            }
            chunk.clear();
            if !self.receive(deadline, &mut chunk)? {
                packets.extend(self.decoder.time_out());
                break;
            }
            self.decoder.push(&chunk);
            packets.extend(self.decoder.drain());
        }
        self.statistics.note_stream(&packets);
        Ok((packets, started.elapsed()))
    }

    fn reply_timeout(&self, on_the_line: f64) -> Duration {
        Duration::from_secs_f64(on_the_line + self.settings.slack)
    }

    /// Discards bytes that came too late for their own request, then sends `wire`.
    fn transmit(&mut self, wire: &[u8]) -> Result<Instant, BusError> {
        let mut late = Vec::new();
        self.receive(Instant::now(), &mut late)?;
        self.statistics.late_bytes += late.len() as u64;
        self.decoder = Decoder::default();
        self.port.write_all(wire).map_err(|source| self.port_error(source))?;
        if let Some(tap) = &mut self.tap {
            tap.packet(Direction::Sent, wire);
        }
        Ok(Instant::now())
    }

    /// Appends the bytes that come until `deadline`; returns true if any came.
    fn receive(&mut self, deadline: Instant, into: &mut Vec<u8>) -> Result<bool, BusError> {
        let left = deadline.saturating_duration_since(Instant::now());
        // The port's time-out is in whole milliseconds.
        let wait = if left.is_zero() { left } else { left.max(Duration::from_millis(1)) };
        self.port.set_read_timeout(wait).map_err(|source| self.port_error(source))?;
        let mut buffer = [0; 1024];
        match self.port.read(&mut buffer) {
            Ok(0) => Err(self.port_error(ErrorKind::UnexpectedEof.into())),
            Ok(count) => {
                into.extend_from_slice(&buffer[..count]);
                if let Some(tap) = &mut self.tap {
                    tap.packet(Direction::Received, &buffer[..count]);
                }
                Ok(true)
            }
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock) => Ok(false),
            Err(source) => Err(self.port_error(source)),
        }
    }

    fn port_error(&self, source: std::io::Error) -> BusError {
        BusError::Port { port: self.path.clone(), source }
    }
}

fn ping_reply(status: &Status) -> Option<PingReply> {
    match status.data[..] {
        [low, high, firmware] => Some(PingReply { id: status.id, model: u16::from_le_bytes([low, high]), firmware }),
        _ => None,
    }
}
