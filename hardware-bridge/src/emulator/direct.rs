//! The emulated devices without wires: the same servos, camera board, supervisor and arm arithmetic as in
//! [`super::lockstep`], called as functions.
//!
//! Goals still pass the supervisor's limits and the servos' registers, set-points are rounded to single-precision
//! degrees, and images get the board's noise and JPEG encoding. There are no pseudo-terminals, sockets, packets,
//! threads, deadlines or sessions. A trial on this robot must therefore equal one on the lock-step robot bit by bit;
//! any difference is caused by the wires.

use std::sync::Arc;

use dynamixel_bus::register::Register;
use dynamixel_bus::xc330::{self, PRESENT_BLOCK_LONG};
use hand_model::RobotModel;
use hand_model::robot::{Observation, Plant, Readings, RobotBackend, RobotCommand, RobotError, TactileFrame, Tick};

use super::camera_board::CameraBoard;
use super::direct_arm::DirectArm;
use super::lockstep::{LockstepSettings, emulated_calibration};
use super::servo::EmulatedServo;
use crate::hand_bus::decode_reading;
use crate::hardware_robot::sent_command;
use crate::kortex_link::to_gen3;
use crate::safety::checks::{ArmReading, Measurements};
use crate::safety::state::SupervisorState;
use crate::safety::supervisor::{CheckFailed, ControllerCommand, SafeCommand, Supervisor, SupervisorStep};
use crate::supported_robot::SERVOS;
use crate::tactile_link::deframer::Deframer;
use crate::tactile_link::image_data;
use crate::tactile_link::message::LinkMessage;

pub struct DirectRobot {
    plant: Box<dyn Plant + Send>,
    servos: Vec<EmulatedServo>,
    /// Whole turns to subtract from each servo's reading, rad.
    forget: [Option<f64>; SERVOS],
    board: CameraBoard,
    images: Vec<TactileFrame>,
    arm: DirectArm,
    supervisor: Supervisor,
    sent: SafeCommand,
    measured: Measurements,
    capture: bool,
    time: f64,
    sequence: u64,
    /// Number of commands so far.
    command_count: u64,
}

impl DirectRobot {
    /// Switches on the devices of `robot` around `plant`, checks and arms.
    ///
    /// # Errors
    /// The check that failed.
    pub fn start(
        mut plant: Box<dyn Plant + Send>,
        settings: LockstepSettings,
        robot: &RobotModel,
    ) -> Result<Self, CheckFailed> {
        let devices = settings.devices;
        let observation = plant.observe();
        let calibration = emulated_calibration(robot, &devices.servos, &settings.travel);
        let limits = settings.limits.limits(&settings.travel, &robot.arm);
        let mut supervisor = Supervisor::new(limits).with_monitors(robot);
        supervisor.connect()?;
        let cameras = robot.hand.cameras.len();
        let mut started = Self {
            plant,
            servos: devices.servos,
            forget: [None; SERVOS],
            board: CameraBoard::new(devices.board, cameras, devices.faults.probabilities.jpeg, devices.seed),
            images: Vec::new(),
            arm: DirectArm::new(&robot.arm, observation.arm),
            supervisor,
            sent: SafeCommand { arm: observation.arm.position, ..SafeCommand::at_rest(&limits) },
            measured: Measurements::none(SERVOS),
            capture: false,
            time: 0.0,
            sequence: 0,
            command_count: 0,
        };
        for (n, servo) in started.servos.iter_mut().enumerate() {
            servo.advance(0.0, 0.0, observation.servos[n]);
            servo.set_homing_offset(calibration.servos[n].homing_offset);
        }
        started.measure(&observation);
        started.supervisor.check(&started.measured, 0.0)?;
        started.sent = started.supervisor.arm(&started.measured, 0.0)?;
        started.write(&xc330::TORQUE_ENABLE, |_| 1.0);
        started.write_goals();
        let watchdog = started.supervisor.limits().watchdogs.servo_bus;
        started.write(&xc330::BUS_WATCHDOG, |_| watchdog);
        Ok(started)
    }

    /// Returns the supervisor's state.
    pub fn state(&self) -> SupervisorState {
        self.supervisor.state()
    }

    /// Writes a register of every servo. A refused value is lost, as in a sync write.
    fn write(&mut self, register: &Register, value: impl Fn(usize) -> f64) {
        for (n, servo) in self.servos.iter_mut().enumerate() {
            servo.feed_watchdog(self.time);
            // The supervisor's limits lie within what a register can hold.
            if let Ok(bytes) = register.write(value(n)) {
                let _ = servo.write(register.address, &bytes);
            }
        }
    }

    /// Writes the goals, current before position, as [`crate::hand_bus::HandBus::send`] does.
    fn write_goals(&mut self) {
        let (goals, forget) = (self.sent.servos, self.forget);
        self.write(&xc330::GOAL_CURRENT, |n| goals[n].current);
        self.write(&xc330::GOAL_POSITION, |n| goals[n].angle + forget[n].unwrap_or(0.0));
    }

    /// Measures as the bridge does, with the plant in the state `seen`.
    fn measure(&mut self, seen: &Observation) {
        let (start, length) = (PRESENT_BLOCK_LONG.start, PRESENT_BLOCK_LONG.end - PRESENT_BLOCK_LONG.start);
        for (n, servo) in self.servos.iter_mut().enumerate() {
            servo.feed_watchdog(self.time);
            let block = servo.read(start, length).unwrap_or_default();
            self.measured.servos[n] = decode_reading(&block, servo.alert(), &mut self.forget[n], self.time);
        }
        let state = self.arm.measure(seen.arm);
        self.measured.arm = Some(ArmReading { received_at: self.time, state, fault: self.arm.fault });
    }

    /// Passes images taken at `taken` (s) through the board's encoding.
    fn encode_images(&mut self, frames: &[TactileFrame], taken: f64) {
        let wire = self.board.send_images(frames, taken);
        for message in Deframer::default().push(&wire).into_iter().flatten() {
            if let LinkMessage::Image(image) = message
                && let Ok(pixels) = image_data::decode(&image)
            {
                let (camera, sequence) = (usize::from(image.camera), u64::from(image.sequence));
                self.images.push(TactileFrame { camera, time: taken, sequence, image: Arc::new(pixels) });
            }
        }
    }
}

impl RobotBackend for DirectRobot {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        let tactile = std::mem::take(&mut self.images);
        Ok(self.measured.readings(self.time, self.sequence, tactile))
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        self.capture = command.capture;
        self.command_count += 1;
        let asked = ControllerCommand { command, received_at: self.time, number: self.command_count };
        if let SupervisorStep::Send(safe) = self.supervisor.step(self.time, Some(asked), &self.measured) {
            self.sent = safe;
            self.arm.target = Some(to_gen3(&safe.arm));
            self.write_goals();
        }
        Ok(sent_command(command, &self.sent, self.supervisor.state()))
    }

    fn wait_for_tick(&mut self) -> Tick {
        let tick = self.plant.tick_length();
        self.arm.advance(tick);
        self.time += tick;
        let servos = self.servos.iter().map(|servo| servo.applied_goal()).collect();
        let capture = std::mem::take(&mut self.capture);
        self.plant.send(&RobotCommand { arm: self.arm.goal, servos, capture });
        self.plant.wait_for_tick();
        let seen = self.plant.observe();
        for (servo, shaft) in self.servos.iter_mut().zip(&seen.servos) {
            servo.advance(self.time, tick, *shaft);
        }
        if let Some(first) = seen.tactile.first() {
            self.encode_images(&seen.tactile, self.time - (seen.time - first.time));
        }
        self.measure(&seen);
        self.sequence += 1;
        Tick { time: self.time, lateness: 0.0 }
    }

    fn tick_length(&self) -> f64 {
        self.plant.tick_length()
    }
}
