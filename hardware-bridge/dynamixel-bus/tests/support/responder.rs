// Servos on a pseudo-terminal, for tests and examples without hardware: their registers hold what is written, and a
// shaft with torque is at its goal at once. (No `//!` and no `use` of the parent: documentation examples include this
// file.)

use std::collections::BTreeMap;
use std::os::fd::AsRawFd as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use dynamixel_bus::models::Model;
use dynamixel_bus::protocol2::{BROADCAST_ID, BulkRead, BulkWrite, Decoder, Instruction, Packet, fast_sync};
use dynamixel_bus::register::{Access, Register};
use dynamixel_bus::xc330::{GOAL_POSITION, HARDWARE_ERROR_STATUS, ID, PRESENT_POSITION, TORQUE_ENABLE};
use dynamixel_bus::{ServoError, Status};
use serial2::SerialPort;

/// Running servos; they end when dropped.
pub struct Responder {
    /// Port of their bus.
    pub path: PathBuf,
    // Kept open, so that the device's end survives when a host closes the port.
    _host: SerialPort,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Responder {
    /// Starts servos of one model with factory settings and these ids.
    pub fn start(model: &'static Model, ids: &[u8]) -> std::io::Result<Self> {
        let (mut device, host) = SerialPort::pair()?;
        let path = std::fs::read_link(format!("/proc/self/fd/{}", host.as_raw_fd()))?;
        device.set_read_timeout(Duration::from_millis(20))?;
        let mut servos: BTreeMap<u8, Servo> = ids.iter().map(|id| (*id, Servo::factory(model, *id))).collect();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let thread = std::thread::spawn(move || {
            let (mut decoder, mut buffer) = (Decoder::default(), [0; 1024]);
            while !stopped.load(Ordering::Relaxed) {
                let Ok(count) = device.read(&mut buffer) else { continue };
                decoder.push(&buffer[..count]);
                for packet in decoder.drain().into_iter().flatten() {
                    device.write_all(&answer(&mut servos, &packet)).expect("the pseudo-terminal works");
                }
            }
        });
        Ok(Self { path, _host: host, stop, thread: Some(thread) })
    }
}

impl Drop for Responder {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Servo {
    model: &'static Model,
    memory: [u8; 1024],
    registered: Option<(u16, Vec<u8>)>,
}

impl Servo {
    fn factory(model: &'static Model, id: u8) -> Self {
        let mut servo = Self { model, memory: [0; 1024], registered: None };
        for register in model.registers {
            servo.set(register, register.default.unwrap_or(0));
        }
        servo.set(&ID, id.into());
        let named = |name: &str| model.register(name).expect("in all models");
        let limit = |name: &str| named(name).default.expect("a limit");
        let voltage = (limit("Min Voltage Limit") + limit("Max Voltage Limit")) / 2;
        servo.set(named("Firmware Version"), 52);
        servo.set(named("Present Input Voltage"), voltage);
        servo.set(named("Present Temperature"), 31);
        servo.set(&PRESENT_POSITION, 2048);
        servo
    }

    fn set(&mut self, register: &Register, counts: i64) {
        let (start, size) = (usize::from(register.address), usize::from(register.size));
        self.memory[start..start + size].copy_from_slice(&counts.to_le_bytes()[..size]);
    }

    fn read(&self, address: u16, length: u16) -> Result<Vec<u8>, ServoError> {
        let start = usize::from(address);
        self.memory.get(start..start + usize::from(length)).map(<[u8]>::to_vec).ok_or(ServoError::Access)
    }

    fn write(&mut self, address: u16, data: &[u8]) -> Result<Vec<u8>, ServoError> {
        let register = self.model.registers.iter().find(|register| register.address == address);
        let torque = self.memory[usize::from(TORQUE_ENABLE.address)] != 0;
        match register.ok_or(ServoError::Access)?.access {
            Access::Read => return Err(ServoError::Access),
            Access::Eeprom if torque => return Err(ServoError::Access),
            _ => {}
        }
        let start = usize::from(address);
        self.memory.get_mut(start..start + data.len()).ok_or(ServoError::DataLength)?.copy_from_slice(data);
        if address == GOAL_POSITION.address && torque {
            let shaft = usize::from(PRESENT_POSITION.address);
            self.memory[shaft..shaft + data.len()].copy_from_slice(data);
        }
        Ok(Vec::new())
    }

    fn execute(&mut self, instruction: &Instruction) -> Result<Vec<u8>, ServoError> {
        match instruction {
            Instruction::Ping => Ok([self.read(0, 2)?, self.read(6, 1)?].concat()),
            Instruction::Read { address, length } => self.read(*address, *length),
            Instruction::Write { address, data } => self.write(*address, data),
            Instruction::RegWrite { address, data } => {
                self.registered = Some((*address, data.clone()));
                Ok(Vec::new())
            }
            Instruction::Action => {
                let (address, data) = self.registered.take().ok_or(ServoError::Instruction)?;
                self.write(address, &data)
            }
            Instruction::Reboot => {
                self.set(&TORQUE_ENABLE, 0);
                Ok(Vec::new())
            }
            _ => Err(ServoError::Instruction),
        }
    }

    fn status(&self, id: u8, result: Result<Vec<u8>, ServoError>) -> Status {
        let alert = self.memory[usize::from(HARDWARE_ERROR_STATUS.address)] != 0;
        match result {
            Ok(data) => Status { id, alert, error: None, data },
            Err(error) => Status { id, alert, error: Some(error), data: Vec::new() },
        }
    }
}

/// Returns the bytes with which the servos answer a packet.
fn answer(servos: &mut BTreeMap<u8, Servo>, packet: &Packet) -> Vec<u8> {
    let read = |servos: &BTreeMap<u8, Servo>, reads: &[BulkRead]| -> Vec<Status> {
        // A missing servo silences those after it.
        let present = reads.iter().map_while(|read| Some((read, servos.get(&read.id)?)));
        present.map(|(read, servo)| servo.status(read.id, servo.read(read.address, read.length))).collect()
    };
    let same = |ids: Vec<u8>, address, length| -> Vec<BulkRead> {
        ids.into_iter().map(|id| BulkRead { id, address, length }).collect()
    };
    let together = |servos: &BTreeMap<u8, Servo>, reads: &[BulkRead]| {
        let lengths: Vec<usize> = reads.iter().map(|read| read.length.into()).collect();
        fast_sync::encode(&lengths, &read(servos, reads))
    };
    let statuses = match Instruction::decode(packet) {
        Ok(Instruction::SyncRead { address, length, ids }) => read(servos, &same(ids, address, length)),
        Ok(Instruction::BulkRead(reads)) => read(servos, &reads),
        Ok(Instruction::FastSyncRead { address, length, ids }) => return together(servos, &same(ids, address, length)),
        Ok(Instruction::FastBulkRead(reads)) => return together(servos, &reads),
        Ok(Instruction::SyncWrite { address, data, .. }) => {
            for (id, data) in data {
                let _ = servos.get_mut(&id).map(|servo| servo.write(address, &data));
            }
            Vec::new()
        }
        Ok(Instruction::BulkWrite(writes)) => {
            for BulkWrite { id, address, data } in writes {
                let _ = servos.get_mut(&id).map(|servo| servo.write(address, &data));
            }
            Vec::new()
        }
        Ok(instruction) if packet.id == BROADCAST_ID => {
            let results = servos.iter_mut().map(|(id, servo)| {
                let result = servo.execute(&instruction);
                servo.status(*id, result)
            });
            let statuses: Vec<Status> = results.collect();
            if instruction == Instruction::Ping { statuses } else { Vec::new() }
        }
        Ok(instruction) => servos
            .get_mut(&packet.id)
            .map(|servo| {
                let result = servo.execute(&instruction);
                servo.status(packet.id, result)
            })
            .into_iter()
            .collect(),
        Err(_) => Vec::new(),
    };
    statuses.iter().flat_map(|status| status.encode().expect("fits")).collect()
}
