//! Six emulated servos on one bus: takes packets and returns answers with their times.
//!
//! Line faults are drawn from a seeded generator; nothing else is random. In a sync or bulk read a servo answers only
//! after all servos before it, so a missing servo silences those after it. A refused read ends a fast answer early.
//! (Both are interpretations.) Clear, factory reset and control table backup are refused with error 2.

use dynamixel_bus::protocol2::{BROADCAST_ID, BulkRead, BulkWrite, Instruction, Packet, ServoError, Status, fast_sync};
use dynamixel_bus::servo_bus::timing::LineTiming;
use dynamixel_bus::x_series::hardware_error;
use dynamixel_bus::xc330;
use hand_model::robot::{ServoGoal, ServoState};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::faults::{ANSWER_DELAY, FaultEvent, FaultProbabilities, Faults};
use super::servo::EmulatedServo;
use crate::calibration::HandCalibration;

/// An answer on the line.
#[derive(Debug, Clone, PartialEq)]
pub struct LineAnswer {
    /// Time at which its last byte arrives, s after the request's arrival.
    pub arrival: f64,
    /// Bytes that arrive.
    pub bytes: Vec<u8>,
    /// True if a fault made it late.
    pub delayed: bool,
}

/// The emulated servos and the faults of their line.
#[derive(Debug)]
pub struct ServoChain {
    servos: Vec<EmulatedServo>,
    faults: Faults,
    rng: ChaCha8Rng,
    usb_latency: f64,
}

impl ServoChain {
    /// Creates servos on one line; `usb_latency` (s) is added to every answer, as an adapter would.
    pub fn new(servos: Vec<EmulatedServo>, faults: Faults, usb_latency: f64, seed: u64) -> Self {
        Self { servos, faults, rng: ChaCha8Rng::seed_from_u64(seed), usb_latency }
    }

    /// Writes homing offsets into the servos' memory, as a calibration does over the bus; torque must be off.
    pub fn write_homing_offsets(&mut self, calibration: &HandCalibration) {
        for (servo, known) in self.servos.iter_mut().zip(&calibration.servos) {
            servo.set_homing_offset(known.homing_offset);
        }
    }

    /// Returns the goal that each servo applies to its shaft.
    pub fn applied_goals(&self) -> Vec<ServoGoal> {
        self.servos.iter().map(EmulatedServo::applied_goal).collect()
    }

    /// Returns the number of servos that their bus watchdog has stopped.
    pub fn watchdogs_tripped(&self) -> usize {
        self.servos.iter().filter(|servo| servo.watchdog_tripped()).count()
    }

    /// Returns the servos' last watchdog trips: id, time, and delay after the last packet heard, s.
    pub fn watchdog_trips(&self) -> Vec<(u8, f64, f64)> {
        self.servos.iter().filter_map(|servo| servo.tripped_at().map(|(at, after)| (servo.id(), at, after))).collect()
    }

    /// Advances the servos by `dt` to `now` (s), with the shafts' states from the plant, and applies the faults that
    /// are due. Returns events for other devices.
    pub fn advance(&mut self, now: f64, dt: f64, shafts: &[ServoState]) -> Vec<FaultEvent> {
        let mut others = Vec::new();
        for event in self.faults.take_due(now) {
            if event.concerns_cameras() {
                others.push(event);
            } else {
                self.apply_fault(event, now);
            }
        }
        for (servo, shaft) in self.servos.iter_mut().zip(shafts) {
            servo.advance(now, dt, *shaft);
        }
        others
    }

    /// Applies a servo fault now.
    pub fn apply_fault(&mut self, event: FaultEvent, now: f64) {
        for servo in &mut self.servos {
            match event {
                FaultEvent::Voltage(volts) => servo.set_voltage(volts, now),
                FaultEvent::Overload(id) if id == servo.id() => servo.raise_errors(hardware_error::OVERLOAD),
                FaultEvent::Overheat(id) if id == servo.id() => servo.set_temperature(90.0),
                FaultEvent::Unplug(id) if id == servo.id() => servo.set_unplugged(true, now),
                FaultEvent::Plug(id) if id == servo.id() => servo.set_unplugged(false, now),
                FaultEvent::WrongModel(id) if id == servo.id() => servo.become_other_model(),
                FaultEvent::SwapIds(id) if id == servo.id() => servo.set_id(id + 1),
                FaultEvent::SwapIds(id) if id + 1 == servo.id() => servo.set_id(id),
                _ => {}
            }
        }
    }

    /// Sets the probabilities of random line faults.
    pub fn set_fault_probabilities(&mut self, chances: FaultProbabilities) {
        self.faults.probabilities = chances;
    }

    /// Feeds the bus watchdogs of all servos that listen, as any packet on the line does.
    pub fn feed_watchdogs(&mut self, now: f64) {
        for servo in self.servos.iter_mut().filter(|servo| servo.listens(now)) {
            servo.feed_watchdog(now);
        }
    }

    /// Answers a packet of `length` bytes that arrived at `now` (s) at `baud`; servos set to another rate do not
    /// understand it.
    pub fn handle(&mut self, packet: &Packet, length: usize, baud: u32, now: f64) -> Vec<LineAnswer> {
        let hears = |servo: &EmulatedServo| servo.listens(now) && servo.baud() == baud;
        for servo in self.servos.iter_mut().filter(|servo| hears(servo)) {
            servo.feed_watchdog(now);
        }
        let statuses = match Instruction::decode(packet) {
            Ok(Instruction::SyncRead { address, length, ids }) => {
                self.read_in_turn(&uniform_reads(&ids, address, length), hears)
            }
            Ok(Instruction::BulkRead(reads)) => self.read_in_turn(&reads, hears),
            Ok(Instruction::FastSyncRead { address, length: size, ids }) => {
                let reads = uniform_reads(&ids, address, size);
                let wires = self.read_fast(&reads, hears);
                return self.send(length, baud, wires);
            }
            Ok(Instruction::FastBulkRead(reads)) => {
                let wires = self.read_fast(&reads, hears);
                return self.send(length, baud, wires);
            }
            Ok(Instruction::SyncWrite { address, data, .. }) => {
                let writes = data.into_iter().map(|(id, data)| BulkWrite { id, address, data });
                self.write_each(writes, hears)
            }
            Ok(Instruction::BulkWrite(writes)) => self.write_each(writes, hears),
            instruction => {
                let to_all = packet.id == BROADCAST_ID;
                let ping = matches!(instruction, Ok(Instruction::Ping));
                let addressed = |servo: &&mut EmulatedServo| (to_all || servo.id() == packet.id) && hears(servo);
                let mut statuses: Vec<Status> = self
                    .servos
                    .iter_mut()
                    .filter(addressed)
                    .filter_map(|servo| execute(servo, instruction.as_ref().ok(), now))
                    .collect();
                statuses.sort_by_key(|status| status.id);
                if to_all && !ping { Vec::new() } else { statuses }
            }
        };
        let wires = statuses.iter().filter_map(|status| Some((1, status.encode().ok()?))).collect();
        self.send(length, baud, wires)
    }

    /// Reads from the servos, which answer one after the other.
    fn read_in_turn(&self, reads: &[BulkRead], hears: impl Fn(&EmulatedServo) -> bool) -> Vec<Status> {
        reads
            .iter()
            .map_while(|read| Some((read, self.servos.iter().find(|servo| servo.id() == read.id && hears(servo))?)))
            .filter(|(_, servo)| servo.return_level() > 0)
            .map(|(read, servo)| {
                let (error, data) = match servo.read(read.address, read.length) {
                    Ok(data) => (None, data),
                    Err(error) => (Some(error), Vec::new()),
                };
                Status { id: servo.id(), alert: servo.alert(), error, data }
            })
            .collect()
    }

    /// Builds the packet that the servos write together, with the number of servos in it; empty if the first servo is
    /// silent.
    fn read_fast(&self, reads: &[BulkRead], hears: impl Fn(&EmulatedServo) -> bool) -> Vec<(usize, Vec<u8>)> {
        let mut statuses = self.read_in_turn(reads, hears);
        let good = statuses.iter().take_while(|status| status.error.is_none()).count();
        statuses.truncate(good);
        let lengths: Vec<usize> = reads.iter().map(|read| read.length.into()).collect();
        let wire = fast_sync::encode(&lengths, &statuses);
        if wire.is_empty() { vec![] } else { vec![(statuses.len(), wire)] }
    }

    /// Writes without answers: refusals are lost, as on the real bus.
    fn write_each(
        &mut self,
        writes: impl IntoIterator<Item = BulkWrite>,
        hears: impl Fn(&EmulatedServo) -> bool,
    ) -> Vec<Status> {
        for write in writes {
            for servo in self.servos.iter_mut().filter(|servo| servo.id() == write.id && hears(servo)) {
                let _ = servo.write(write.address, &write.data);
            }
        }
        Vec::new()
    }

    /// Calculates the times of the answers, each written by the given number of servos, and applies line faults to
    /// them.
    fn send(&mut self, request: usize, baud: u32, wires: Vec<(usize, Vec<u8>)>) -> Vec<LineAnswer> {
        let return_delay = self.servos.first().map_or(0.0, EmulatedServo::return_delay);
        let line = LineTiming { baud, return_delay, usb_latency: self.usb_latency, ..LineTiming::default() };
        let mut after = line.bytes(request) + line.usb_latency;
        let mut answers = Vec::new();
        for (servos, mut bytes) in wires {
            after += servos as f64 * (line.return_delay + line.turnaround) + line.bytes(bytes.len());
            let chances = self.faults.probabilities;
            if self.fault_occurs(chances.drop) {
                continue;
            }
            if self.fault_occurs(chances.corrupt) {
                let place = self.rng.random_range(0..bytes.len());
                bytes[place] ^= self.rng.random_range(1..=255_u8);
            }
            if self.fault_occurs(chances.noise) {
                let noise: Vec<u8> = (0..self.rng.random_range(1..=3)).map(|_| self.rng.random()).collect();
                bytes.splice(0..0, noise);
            }
            let delayed = self.fault_occurs(chances.delay);
            answers.push(LineAnswer { arrival: after + if delayed { ANSWER_DELAY } else { 0.0 }, bytes, delayed });
        }
        answers.sort_by(|a, b| a.arrival.total_cmp(&b.arrival));
        answers
    }

    fn fault_occurs(&mut self, chance: f64) -> bool {
        chance > 0.0 && self.rng.random_bool(chance)
    }
}

fn uniform_reads(ids: &[u8], address: u16, length: u16) -> Vec<BulkRead> {
    ids.iter().map(|id| BulkRead { id: *id, address, length }).collect()
}

/// Executes an instruction addressed to one servo; `None` if its status return level keeps it silent.
fn execute(servo: &mut EmulatedServo, instruction: Option<&Instruction>, now: f64) -> Option<Status> {
    let id = servo.id();
    let level = servo.return_level();
    let (needed, result) = match instruction {
        Some(Instruction::Ping) => {
            let word = |address, length| servo.read(address, length);
            let data = word(xc330::MODEL_NUMBER.address, 2)
                .and_then(|model| Ok([model, word(xc330::FIRMWARE_VERSION.address, 1)?].concat()));
            (0, data)
        }
        Some(Instruction::Read { address, length }) => (1, servo.read(*address, *length)),
        Some(Instruction::Write { address, data }) => (2, servo.write(*address, data).map(|()| Vec::new())),
        Some(Instruction::RegWrite { address, data }) => (2, servo.register_write(*address, data).map(|()| Vec::new())),
        Some(Instruction::Action) => (2, servo.execute_registered().map(|()| Vec::new())),
        Some(Instruction::Reboot) => {
            servo.reboot(now);
            (2, Ok(Vec::new()))
        }
        _ => (2, Err(ServoError::Instruction)),
    };
    let (error, data) = match result {
        Ok(data) => (None, data),
        Err(error) => (Some(error), Vec::new()),
    };
    (level >= needed).then(|| Status { id, alert: servo.alert(), error, data })
}

#[cfg(test)]
#[path = "servo_chain_tests.rs"]
mod tests;
