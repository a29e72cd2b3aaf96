//! A robot of another kind behind a link of its own, in lock-step: a gripper with two servos on a UR5e.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use hand_model::RobotModel;
use hand_model::robot::{ArmState, Readings, RobotBackend as _, RobotCommand, ServoGoal, ServoState};
use hardware_bridge::clock::Clock;
use hardware_bridge::config::LimitConfig;
use hardware_bridge::delivered_images::DeliveredImages;
use hardware_bridge::hardware_robot::{HardwareRobot, LinkSettings, LinkTiming};
use hardware_bridge::robot_link::RobotLink;
use hardware_bridge::safety::checks::{ArmReading, Measurements, ServoReading};
use hardware_bridge::safety::limits::WatchdogTimeouts;
use hardware_bridge::safety::state::{StopCause, SupervisorState};
use hardware_bridge::safety::supervisor::SafeCommand;
use hardware_bridge::servo_cycle::CycleReport;

const TRAVEL: f64 = 2.0;

/// Calls of the link, in order.
type Calls = Arc<Mutex<Vec<&'static str>>>;

/// A robot that is where it was sent.
struct Perfect {
    arm: ArmState,
    servos: Vec<ServoState>,
    calls: Calls,
}

impl Perfect {
    fn note(&self, call: &'static str) {
        self.calls.lock().unwrap_or_else(PoisonError::into_inner).push(call);
    }
}

impl RobotLink for Perfect {
    fn measure(&mut self, clock: &Clock, measured: &mut Measurements, _: &mut CycleReport) {
        let received_at = clock.now();
        measured.arm = Some(ArmReading { received_at, state: self.arm, fault: None });
        let reading =
            |state: &ServoState| Some(ServoReading { received_at, state: *state, voltage: None, alert: false });
        measured.servos = self.servos.iter().map(reading).collect();
    }

    fn send(&mut self, command: &SafeCommand, _: &mut CycleReport) -> SafeCommand {
        self.note("send");
        self.arm = ArmState::at_rest(command.arm);
        for (servo, goal) in self.servos.iter_mut().zip(&command.servos) {
            servo.position = goal.angle;
        }
        *command
    }

    fn engage(&mut self, _: &SafeCommand, _: f64) -> Result<(), String> {
        self.note("engage");
        Ok(())
    }

    fn torque_off(&mut self, _: &mut CycleReport) -> Vec<String> {
        self.note("torque off");
        Vec::new()
    }

    fn park(&mut self, _: &mut CycleReport) {
        self.note("park");
    }

    fn step(&mut self, _: &mut CycleReport) {
        self.note("step");
    }

    fn standstill_limit(&self, _: &WatchdogTimeouts) -> f64 {
        f64::INFINITY
    }

    fn senses_torque(&self) -> bool {
        false
    }
}

/// Returns the armed robot, its model and the calls of its link.
fn armed() -> (HardwareRobot, RobotModel, Calls) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../hand-model/data/robots/franka_ur5e.toml");
    let model = RobotModel::read(&file).expect("a robot");
    assert_eq!((model.arm.joints(), model.hand.servos.len()), (6, 2));
    let calls = Calls::default();
    let warm = ServoState { temperature: 30.0, ..ServoState::default() };
    let link = Perfect { arm: ArmState::at_rest(model.arm.home), servos: vec![warm; 2], calls: calls.clone() };
    let settings = LinkSettings {
        limits: LimitConfig::for_robot(&model).limits(&[TRAVEL; 2], &model.arm),
        timing: LinkTiming::Lockstep,
        images: Some(DeliveredImages::default()),
        file: &file,
        order_timeout: Duration::from_secs(60),
    };
    let robot = HardwareRobot::start(link, &model, settings).expect("started");
    robot.check().expect("the checks pass");
    robot.arm().expect("arms");
    (robot, model, calls)
}

fn command(model: &RobotModel, shift: f64) -> RobotCommand {
    let mut arm = model.arm.home;
    arm[5] += shift;
    let goal = ServoGoal::Position { angle: 10.0, current_limit: 10.0 };
    RobotCommand { arm, servos: [goal; 2].into_iter().collect(), capture: false }
}

#[test]
fn another_robot_is_limited_in_lock_step() {
    let (mut robot, model, _) = armed();
    let limits = LimitConfig::for_robot(&model);
    for _ in 0..600 {
        let before = robot.observe().and_then(Readings::into_observation).expect("observed");
        let sent = robot.send(&command(&model, 0.5)).expect("sent");
        let step = sent.arm[5] - before.arm.position[5];
        assert!(step.abs() <= model.arm.velocity_limits[5] * robot.tick_length() + 1e-9, "{step}");
        for (goal, servo) in sent.servos.iter().zip(&before.servos) {
            let ServoGoal::Position { angle, current_limit } = *goal else { panic!("{goal:?}") };
            assert!(angle - servo.position <= limits.speed * robot.tick_length() + 1e-9, "{angle}");
            assert_eq!(current_limit, limits.current);
        }
        robot.wait_for_tick();
    }
    let reached = robot.observe().and_then(Readings::into_observation).expect("observed");
    assert!((reached.arm.position[5] - model.arm.home[5] - 0.5).abs() < 1e-9);
    assert_eq!(reached.servos.iter().map(|servo| servo.position).collect::<Vec<_>>(), [TRAVEL; 2]);
    // Time has passed with the ticks alone.
    assert!((reached.time - 600.0 * robot.tick_length()).abs() < 1e-6, "{}", reached.time);
}

/// Ticks without a command carry out the last one, and a hold; a release fades and ends with the torque off.
#[test]
fn ticks_holds_and_releases_in_lock_step() {
    let (mut robot, model, calls) = armed();
    robot.send(&command(&model, 0.0)).expect("sent");
    robot.wait_for_tick();
    robot.wait_for_tick();
    robot.hold().expect("holds");
    robot.wait_for_tick();
    assert_eq!(robot.state(), SupervisorState::Hold(StopCause::Operator));
    let said: Vec<_> = calls.lock().expect("calls").drain(..).collect();
    assert_eq!(said, ["engage", "send", "step", "send", "step", "send", "step"]);
    assert_eq!(robot.release().expect("released"), "torque read back as off from 2 of 2 servos");
    assert_eq!(robot.state(), SupervisorState::Connected);
    let said: Vec<_> = calls.lock().expect("calls").drain(..).collect();
    assert_eq!(said.last(), Some(&"torque off"));
    let fading = said.iter().filter(|call| **call == "send").count() as f64 * robot.tick_length();
    assert!((fading - LimitConfig::default().release_time).abs() < 0.1, "{fading} s");
    drop(robot);
    // The torque was off already.
    assert_eq!(*calls.lock().expect("calls"), Vec::<&str>::new());
}
