//! Host side of the servo bus: requests, and answers that arrive before a deadline or count as missing.
//!
//! A [`ServoBus`] owns the serial port. A call that concerns one servo fails with that servo's [`BusError`]. A call
//! that concerns several returns a result for each of them ([`ReplyError`]), so that a silent servo does not hide the
//! others. There are no retries: the next control cycle asks again.
//!
//! [`timing`] calculates the duration of a cycle, [`statistics`] measures it, [`latency_timer`] reads the delay of the
//! USB adapter.

mod error;
mod group;
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
use crate::protocol2::{
    BROADCAST_ID, Decoder, Instruction, Packet, ReplyError, Status, StreamError, sync_read_replies,
};
use crate::register::Register;
use crate::tap::{Direction, Tap};

pub use error::BusError;

/// Maximum time for which an answer may be awaited, s.
const MAX_TIMEOUT: f64 = 3600.0;

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
    /// Id of the servo.
    pub id: u8,
    /// Model number; the key of [`crate::models::Model::by_number`].
    pub model: u16,
    /// Firmware version.
    pub firmware: u8,
}

/// An open servo bus.
///
/// # Example
/// ```
/// # include!(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/support/responder.rs"));
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let servos = Responder::start(&dynamixel_bus::models::xl330_m288::MODEL, &[1, 2])?;
/// # let port = &servos.path;
/// use dynamixel_bus::models::xl330_m288::{GOAL_POSITION, OPERATING_MODE, PRESENT_POSITION};
/// use dynamixel_bus::x_series::mode;
/// use dynamixel_bus::{BusSettings, ReplyError, ServoBus};
///
/// // `port` is for example /dev/ttyUSB0.
/// let mut bus = ServoBus::open(port, BusSettings { slack: 0.5, ..BusSettings::default() })?;
/// for id in [1, 2] {
///     bus.write(id, &OPERATING_MODE, mode::POSITION as f64)?;
/// }
/// assert!(bus.set_torque(&[1, 2], true).iter().all(Result::is_ok));
/// bus.sync_write_values(&GOAL_POSITION, &[(1, 2.0), (2, 3.0)])?;
///
/// // Servo 3 is not there; the others answer.
/// let angles = bus.sync_read_register(&[1, 2, 3], &PRESENT_POSITION)?;
/// assert!(angles[0].as_ref().is_ok_and(|angle| (angle - 2.0).abs() < 1e-3));
/// assert_eq!(angles[2], Err(ReplyError::Missing(3)));
///
/// let statistics = bus.statistics();
/// println!("{} missing, median round trip {:?} s", statistics.missing, statistics.round_trip(0.5));
/// # Ok(())
/// # }
/// ```
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
    /// Opens the port in raw mode, 8N1, for exclusive use ([`exclusive`]).
    ///
    /// # Errors
    /// [`BusError::Port`], [`BusError::Settings`].
    pub fn open(path: impl AsRef<Path>, settings: BusSettings) -> Result<Self, BusError> {
        let path = path.as_ref();
        let times = [settings.return_delay, settings.slack];
        if settings.baud == 0 || !times.iter().all(|time| (0.0..=MAX_TIMEOUT).contains(time)) {
            return Err(BusError::Settings(settings));
        }
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

    /// Sets the time-out of an answer beyond its time on the line, s. Requests fail with [`BusError::Settings`] if it is
    /// negative, above an hour or no number.
    pub fn set_slack(&mut self, seconds: f64) {
        self.settings.slack = seconds;
    }

    /// Pings servo `id`.
    pub fn ping(&mut self, id: u8) -> Result<PingReply, BusError> {
        let status = self.ask_one(id, &Instruction::Ping, 3)?;
        ping_reply(&status).ok_or(BusError::Reply(ReplyError::Missing(id)))
    }

    /// Pings all servos at once and collects answers for `timeout`; sorted by id.
    pub fn scan(&mut self, timeout: Duration) -> Result<Vec<PingReply>, BusError> {
        let wire = Instruction::Ping.encode(BROADCAST_ID)?;
        let deadline = self.transmit(&wire)? + timeout;
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

    /// Writes `data` from `address` on in one servo and waits for its acknowledgement.
    pub fn write_block(&mut self, id: u8, address: u16, data: &[u8]) -> Result<(), BusError> {
        self.ask_one(id, &Instruction::Write { address, data: data.to_vec() }, 0)?;
        Ok(())
    }

    /// Reads a register, as a value in SI.
    pub fn read(&mut self, id: u8, register: &Register) -> Result<f64, BusError> {
        let status = self.read_block(id, register.address, register.size.into())?;
        register.read(&status.data).map_err(|source| BusError::Register { id, source })
    }

    /// Writes a value in SI and waits for the servo's acknowledgement.
    pub fn write(&mut self, id: u8, register: &Register, si: f64) -> Result<(), BusError> {
        let data = register.write(si).map_err(|source| BusError::Register { id, source })?;
        self.write_block(id, register.address, &data)
    }

    /// Registers a write of a value in SI, which waits for [`Self::action`], and waits for the servo's acknowledgement.
    pub fn reg_write(&mut self, id: u8, register: &Register, si: f64) -> Result<(), BusError> {
        let data = register.write(si).map_err(|source| BusError::Register { id, source })?;
        self.ask_one(id, &Instruction::RegWrite { address: register.address, data }, 0)?;
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
        let bytes: Vec<usize> = sizes.iter().map(|size| timing::STATUS_OVERHEAD + size).collect();
        let timeout = self.reply_timeout(self.timing().answers(wire.len(), &bytes))?;
        let started = self.transmit(&wire)?;
        let deadline = started + timeout;
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

    fn reply_timeout(&self, on_the_line: f64) -> Result<Duration, BusError> {
        let seconds = on_the_line + self.settings.slack;
        if !(0.0..=MAX_TIMEOUT).contains(&seconds) {
            return Err(BusError::Settings(self.settings));
        }
        Ok(Duration::from_secs_f64(seconds))
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
