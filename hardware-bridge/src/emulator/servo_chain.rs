//! Six emulated servos on one bus: it takes packets and returns answers with their times.
//!
//! Line faults are drawn from a seeded generator; nothing else is random. In a sync read a servo answers only after all servos before it, so a
//! missing servo silences those after it (our reading). Instructions that the bridge does not use (bulk, registered, clear, factory reset) are
//! refused with error 2.

use hand_model::robot::{ServoGoal, ServoState};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::faults::{Chances, DELAY, Event, Faults};
use super::servo::EmulatedServo;
use crate::calibration::HandCalibration;
use crate::protocol2::{BROADCAST, Instruction, Packet, ServoError, Status, fast_sync};
use crate::servo_bus::timing::LineTiming;
use crate::xc330::{self, hardware_error};

/// Bytes to put onto the line.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// When its last byte arrives, s after the request's arrival.
    pub after: f64,
    /// What arrives.
    pub bytes: Vec<u8>,
    /// Whether a fault made it late.
    pub delayed: bool,
}

/// The emulated servos and what is wrong with their line.
#[derive(Debug)]
pub struct ServoChain {
    servos: Vec<EmulatedServo>,
    faults: Faults,
    rng: ChaCha8Rng,
    usb_latency: f64,
}

impl ServoChain {
    /// Servos on one line; `usb_latency` (s) is added to every answer as an adapter would.
    pub fn new(servos: Vec<EmulatedServo>, faults: Faults, usb_latency: f64, seed: u64) -> Self {
        Self { servos, faults, rng: ChaCha8Rng::seed_from_u64(seed), usb_latency }
    }

    /// Writes homing offsets into the servos' memory, as a calibration does over the bus; torque must be off.
    pub fn home(&mut self, calibration: &HandCalibration) {
        for (servo, known) in self.servos.iter_mut().zip(&calibration.servos) {
            servo.set_homing_offset(known.homing_offset);
        }
    }

    /// What each servo makes its shaft do.
    pub fn drives(&self) -> Vec<ServoGoal> {
        self.servos.iter().map(EmulatedServo::drive).collect()
    }

    /// How many servos have been stopped by their bus watchdog.
    pub fn watchdogs_tripped(&self) -> usize {
        self.servos.iter().filter(|servo| servo.watchdog_tripped()).count()
    }

    /// Servos stopped by their bus watchdog: id, when (s), and how long after the last packet that it heard, s.
    pub fn watchdog_trips(&self) -> Vec<(u8, f64, f64)> {
        self.servos.iter().filter_map(|servo| servo.tripped_at().map(|(at, after)| (servo.id(), at, after))).collect()
    }

    /// Lets `dt` pass with the shafts as the plant has them, and faults that are due happen. Returns events for other devices.
    pub fn advance(&mut self, now: f64, dt: f64, shafts: &[ServoState]) -> Vec<Event> {
        let mut others = Vec::new();
        for event in self.faults.due(now) {
            if matches!(event, Event::Freeze(_)) {
                others.push(event);
            } else {
                self.happen(event, now);
            }
        }
        for (servo, shaft) in self.servos.iter_mut().zip(shafts) {
            servo.advance(now, dt, *shaft);
        }
        others
    }

    /// Makes a servo fault happen now.
    pub fn happen(&mut self, event: Event, now: f64) {
        for servo in &mut self.servos {
            match event {
                Event::Voltage(volts) => servo.set_voltage(volts, now),
                Event::Overload(id) if id == servo.id() => servo.raise(hardware_error::OVERLOAD),
                Event::Overheat(id) if id == servo.id() => servo.set_temperature(90.0),
                Event::Unplug(id) if id == servo.id() => servo.set_unplugged(true, now),
                Event::Plug(id) if id == servo.id() => servo.set_unplugged(false, now),
                _ => {}
            }
        }
    }

    /// Changes the chances of random line faults.
    pub fn set_chances(&mut self, chances: Chances) {
        self.faults.chances = chances;
    }

    /// Answers a packet of `length` bytes that arrived at `now` at `baud`; servos set to another rate do not understand it.
    pub fn handle(&mut self, packet: &Packet, length: usize, baud: u32, now: f64) -> Vec<Answer> {
        let hears = |servo: &EmulatedServo| servo.listens(now) && servo.baud() == baud;
        for servo in self.servos.iter_mut().filter(|servo| hears(servo)) {
            servo.feed_watchdog(now);
        }
        let statuses = match Instruction::decode(packet) {
            Ok(Instruction::SyncRead { address, length, ids }) => self.sync_read(&ids, address, length, hears),
            Ok(Instruction::FastSyncRead { address, length: size, ids }) => {
                let statuses = self.sync_read(&ids, address, size, hears);
                let wire = fast_sync::encode(ids.len(), size.into(), &statuses);
                return self.send(length, baud, if wire.is_empty() { vec![] } else { vec![(statuses.len(), wire)] });
            }
            Ok(Instruction::SyncWrite { address, data, .. }) => {
                for (id, bytes) in data {
                    for servo in self.servos.iter_mut().filter(|servo| servo.id() == id && hears(servo)) {
                        // Refusals of a sync write are lost, as on the real bus.
                        let _ = servo.write(address, &bytes);
                    }
                }
                Vec::new()
            }
            instruction => {
                let to_all = packet.id == BROADCAST;
                let ping = matches!(instruction, Ok(Instruction::Ping));
                let addressed = |servo: &&mut EmulatedServo| (to_all || servo.id() == packet.id) && hears(servo);
                let mut statuses: Vec<Status> = self
                    .servos
                    .iter_mut()
                    .filter(addressed)
                    .filter_map(|servo| obey(servo, instruction.as_ref().ok(), now))
                    .collect();
                statuses.sort_by_key(|status| status.id);
                if to_all && !ping { Vec::new() } else { statuses }
            }
        };
        let wires = statuses.iter().filter_map(|status| Some((1, status.encode().ok()?))).collect();
        self.send(length, baud, wires)
    }

    fn sync_read(&self, ids: &[u8], address: u16, length: u16, hears: impl Fn(&EmulatedServo) -> bool) -> Vec<Status> {
        ids.iter()
            .map_while(|id| self.servos.iter().find(|servo| servo.id() == *id && hears(servo)))
            .filter_map(|servo| {
                let data = servo.read(address, length).ok()?;
                (servo.return_level() > 0).then(|| Status { id: servo.id(), alert: servo.alert(), error: None, data })
            })
            .collect()
    }

    /// Times the answers, each written by so many servos, and lets line faults have their way with them.
    fn send(&mut self, request: usize, baud: u32, wires: Vec<(usize, Vec<u8>)>) -> Vec<Answer> {
        let return_delay = self.servos.first().map_or(0.0, EmulatedServo::return_delay);
        let line = LineTiming { baud, return_delay, usb_latency: self.usb_latency, ..LineTiming::default() };
        let mut after = line.bytes(request) + line.usb_latency;
        let mut answers = Vec::new();
        for (servos, mut bytes) in wires {
            after += servos as f64 * (line.return_delay + line.turnaround) + line.bytes(bytes.len());
            let chances = self.faults.chances;
            if self.strikes(chances.drop) {
                continue;
            }
            if self.strikes(chances.corrupt) {
                let place = self.rng.random_range(0..bytes.len());
                bytes[place] ^= self.rng.random_range(1..=255_u8);
            }
            if self.strikes(chances.noise) {
                let noise: Vec<u8> = (0..self.rng.random_range(1..=3)).map(|_| self.rng.random()).collect();
                bytes.splice(0..0, noise);
            }
            let delayed = self.strikes(chances.delay);
            answers.push(Answer { after: after + if delayed { DELAY } else { 0.0 }, bytes, delayed });
        }
        answers.sort_by(|a, b| a.after.total_cmp(&b.after));
        answers
    }

    fn strikes(&mut self, chance: f64) -> bool {
        chance > 0.0 && self.rng.random_bool(chance)
    }
}

/// What one servo does about an instruction addressed to it; `None` where its status return level keeps it silent.
fn obey(servo: &mut EmulatedServo, instruction: Option<&Instruction>, now: f64) -> Option<Status> {
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
mod tests {
    use super::*;
    use crate::protocol2::Decoder;

    const BAUD: u32 = 3_000_000;

    fn chain(faults: &[&str]) -> ServoChain {
        let servos = (1..=6).map(|id| EmulatedServo::provisioned(id, 0)).collect();
        ServoChain::new(servos, Faults::parse(faults.iter().copied()).expect("faults"), 0.0, 1)
    }

    fn ask(chain: &mut ServoChain, id: u8, instruction: Instruction, now: f64) -> Vec<Status> {
        let wire = instruction.encode(id).expect("fits");
        let mut decoder = Decoder::default();
        decoder.push(&wire);
        let packet = decoder.next_packet().expect("whole").expect("good");
        let answers = chain.handle(&packet, wire.len(), BAUD, now);
        answers.iter().for_each(|answer| decoder.push(&answer.bytes));
        decoder.time_out().into_iter().flatten().filter_map(|packet| Status::decode(&packet)).collect()
    }

    fn ids(statuses: &[Status]) -> Vec<u8> {
        statuses.iter().map(|status| status.id).collect()
    }

    #[test]
    fn broadcast_ping_and_single_reads() {
        let mut chain = chain(&[]);
        assert_eq!(ids(&ask(&mut chain, BROADCAST, Instruction::Ping, 0.0)), [1, 2, 3, 4, 5, 6]);
        let model = ask(&mut chain, 3, Instruction::Read { address: 0, length: 2 }, 0.0);
        assert_eq!((model[0].id, &model[0].data[..]), (3, &xc330::MODEL.to_le_bytes()[..]));
        assert_eq!(ids(&ask(&mut chain, 9, Instruction::Ping, 0.0)), [0_u8; 0]);
    }

    #[test]
    fn other_rates_are_not_understood() {
        let mut chain = chain(&[]);
        let packet = Packet { id: 1, instruction: 1, parameters: vec![] };
        assert!(chain.handle(&packet, 10, 57_600, 0.0).is_empty());
    }

    #[test]
    fn an_unplugged_servo_silences_those_after_it() {
        let mut chain = chain(&["unplug=3@1"]);
        let read = || Instruction::SyncRead { address: 126, length: 10, ids: vec![1, 2, 3, 4, 5, 6] };
        assert_eq!(ask(&mut chain, BROADCAST, read(), 0.5).len(), 6);
        chain.advance(1.0, 0.01, &[ServoState::default(); 6]);
        assert_eq!(ids(&ask(&mut chain, BROADCAST, read(), 1.1)), [1, 2]);
    }

    #[test]
    fn overloaded_servo_raises_the_alert_bit() {
        let mut chain = chain(&["overload=2@1"]);
        chain.advance(1.0, 0.01, &[ServoState::default(); 6]);
        let statuses = ask(&mut chain, BROADCAST, Instruction::Ping, 1.1);
        let alerts: Vec<u8> = statuses.iter().filter(|status| status.alert).map(|status| status.id).collect();
        assert_eq!(alerts, [2]);
    }

    /// The time of the last answer is the calculated one.
    #[test]
    fn line_time() {
        let mut chain = chain(&[]);
        let request = Instruction::SyncRead { address: 126, length: 10, ids: vec![1, 2, 3, 4, 5, 6] };
        let wire = request.encode(BROADCAST).expect("fits");
        let mut decoder = Decoder::default();
        decoder.push(&wire);
        let packet = decoder.next_packet().expect("whole").expect("good");
        let answers = chain.handle(&packet, wire.len(), BAUD, 0.0);
        let line = LineTiming { usb_latency: 0.0, ..LineTiming::default() };
        let expected = line.answers(wire.len(), &[21; 6]);
        assert!((answers[5].after - expected).abs() < 1e-12);
    }

    /// Random faults hit about as often as asked for, and the same way with the same seed.
    #[test]
    fn chances() {
        let count = |faults: &[&str]| {
            let mut chain = chain(faults);
            (0..1000).map(|n| ask(&mut chain, 1, Instruction::Ping, f64::from(n)).len()).sum::<usize>()
        };
        assert_eq!(count(&[]), 1000);
        assert_eq!(count(&["noise=1"]), 1000);
        let dropped = count(&["drop=0.1"]);
        assert!((870..930).contains(&dropped), "{dropped}");
        assert_eq!(dropped, count(&["drop=0.1"]));
        assert!((870..930).contains(&count(&["corrupt=0.1"])));
    }
}
