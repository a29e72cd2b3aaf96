//! Drivers that are shell scripts, in lock-step: what passes the supervisor, and how a driver fails.

use std::path::{Path, PathBuf};
use std::process::Command;

use hand_model::robot::{Readings, RobotBackend as _, RobotCommand, ServoGoal};
use hardware_bridge::safety::state::{StopCause, SupervisorState};
use serde_json::json;

use super::description::tests::described;
use super::*;

/// Answers of a script that stands still in the posture of the arm's home.
struct Script {
    model: RobotModel,
    folder: tempfile::TempDir,
    /// Answer to `observe` from the third one on, in the shell's words.
    later: String,
}

impl Script {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        Self { model: RobotModel::ftac_gen3(), folder, later: "echo \"$seen\"".to_owned() }
    }

    fn log(&self) -> PathBuf {
        self.folder.path().join("questions")
    }

    /// Measurements at rest.
    fn measured(&self) -> Value {
        let arm: Vec<[f64; 3]> = self.model.arm.home.iter().map(|angle| [*angle, 0.0, 0.0]).collect();
        let servos = self.model.hand.servos.len();
        json!({
            "servos": vec![[0.5, 0.0, 0.0, 30.0]; servos], "servo_ages": vec![0.0; servos], "arm": arm, "arm_age": 0.0,
        })
    }

    fn start(&self, timeout: u32) -> DrivenRobot {
        let introduction = DriverDescription { senses_torque: false, ..described(&self.model) };
        let script = format!(
            "echo '{}'; seen='{}'; n=0; while read -r line; do echo \"$line\" >> '{}'; case \"$line\" in\n\
             *'\"ask\":\"observe\"'*) n=$((n+1)); if [ $n -gt 2 ]; then {}; else echo \"$seen\"; fi;;\n\
             *) echo '{{}}';; esac; done",
            serde_json::to_string(&introduction).expect("JSON"),
            self.measured(),
            self.log().display(),
            self.later
        );
        let mut command = Command::new("sh");
        command.args(["-c", &script]);
        let started = HostedProcess::start_command(command, Role::Robot, "mine.py:Mine", seconds(timeout));
        let class = PythonClass {
            file: "mine.py".into(),
            class: "Mine".to_owned(),
            sha256: String::new(),
            arguments: Default::default(),
        };
        let started = started.expect("started");
        DrivenRobot::from_process(class, started, Some(timeout), &self.model, None).expect("the robot")
    }

    fn connect(&self, timeout: u32) -> HardwareRobot {
        let driven = self.start(timeout);
        driven.connect(driven.start_process().expect("a process")).expect("connected")
    }

    /// A command at home, with one joint shifted by `shift` (rad).
    fn command(&self, shift: f64) -> RobotCommand {
        let mut arm = self.model.arm.home;
        arm[0] += shift;
        let goal = ServoGoal::Position { angle: 0.5, current_limit: 5.0 };
        RobotCommand { arm, servos: self.model.hand.servos.iter().map(|_| goal).collect(), capture: false }
    }
}

/// The supervisor limits a jump of the arm and an excessive current before the driver gets them.
#[test]
fn commands_pass_the_supervisor() {
    let script = Script::new();
    let mut robot = script.connect(60);
    robot.check().expect("the checks pass");
    robot.arm().expect("arms");
    robot.send(&script.command(0.0)).expect("sent");
    robot.wait_for_tick();
    let sent = robot.send(&script.command(1.0)).expect("sent");
    let tick = robot.wait_for_tick();
    assert_eq!(robot.state(), SupervisorState::Running);
    assert!((tick.time - 2.0 * robot.tick_length()).abs() < 1e-9 && tick.lateness == 0.0, "{tick:?}");
    let moved = sent.arm[0] - script.model.arm.home[0];
    assert!(moved > 0.0 && moved < 0.02, "{moved}");
    drop(robot);
    let questions = std::fs::read_to_string(script.log()).expect("questions");
    let asked: Vec<Value> = questions.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let names: Vec<&str> = asked.iter().map(|question| question["ask"].as_str().expect("a name")).collect();
    let expected = ["observe", "start", "send", "step", "observe", "send", "step", "observe", "send", "stop", "close"];
    assert_eq!(names, expected);
    let jump = &asked[5];
    assert_eq!(jump["arm"][0].as_f64().expect("a number"), sent.arm[0]);
    assert_eq!(jump["servos"][0], json!([0.5, LimitConfig::default().current]));
}

/// A driver that fails in mid-trial stops the robot, with its own words.
#[test]
fn a_driver_that_fails_stops_the_robot() {
    let failed = |later: &str, timeout: u32| {
        let script = Script { later: later.to_owned(), ..Script::new() };
        let mut robot = script.connect(timeout);
        robot.check().expect("the checks pass");
        robot.arm().expect("arms");
        for _ in 0..3 {
            // A failed driver takes no command.
            let _ = robot.send(&script.command(0.0));
            robot.wait_for_tick();
        }
        let _ = robot.send(&script.command(0.0));
        assert_eq!(robot.state(), SupervisorState::Fault(StopCause::DriverFailed));
        // The last measurements stay.
        assert!(robot.observe().and_then(Readings::into_observation).is_ok());
        robot.report().driver_error.expect("its words")
    };
    assert_eq!(failed("exit 3", 60), "observe: its process has ended (exit status: 3)");
    let late = "observe: it has not answered within 1 s (--robot-timeout): its process was ended";
    assert_eq!(failed("sleep 600", 1), late);
    assert_eq!(failed("echo '{\"error\": \"no bus\"}'", 60), "observe: it failed: no bus");
    let words = failed("echo nonsense", 60);
    assert!(words.starts_with("observe: its answer: found nonsense: "), "{words}");
    let script = Script::new();
    let mut short = script.measured();
    short["servos"].as_array_mut().expect("rows").pop();
    assert_eq!(failed(&format!("echo '{short}'"), 60), "observe: its answer: servos: found 5, expected 6");
    let mut early = script.measured();
    early["arm_age"] = json!(-1.0);
    assert_eq!(failed(&format!("echo '{early}'"), 60), "observe: its answer: age: found -1 s, expected 0 or more");
}

/// A reading that its driver marks as old stops the robot.
#[test]
fn old_readings_stop_the_robot() {
    let mut old = Script::new().measured();
    old["servo_ages"][2] = json!(0.2);
    let script = Script { later: format!("echo '{old}'"), ..Script::new() };
    let mut robot = script.connect(60);
    robot.check().expect("the checks pass");
    robot.arm().expect("arms");
    for _ in 0..3 {
        let _ = robot.send(&script.command(0.0));
        robot.wait_for_tick();
    }
    let _ = robot.send(&script.command(0.0));
    assert!(matches!(robot.state(), SupervisorState::Hold(StopCause::ServoSilent(2, _))), "{}", robot.state());
}

/// A description that is no robot of the model is refused with the class that gave it.
#[test]
fn a_driver_of_another_robot_is_refused() {
    let model = RobotModel::ftac_gen3();
    let mut description = described(&model);
    description.servos.pop();
    let mut command = Command::new("sh");
    let introduction = serde_json::to_string(&description).expect("JSON");
    command.args(["-c", &format!("echo '{introduction}'; cat >/dev/null")]);
    let started = HostedProcess::start_command(command, Role::Robot, "mine.py:Mine", seconds(60)).expect("started");
    let class = PythonClass {
        file: "mine.py".into(),
        class: "Mine".to_owned(),
        sha256: String::new(),
        arguments: Default::default(),
    };
    let refused = DrivenRobot::from_process(class, started, None, &model, None::<&Path>).err().expect("refused");
    let words = refused.to_string();
    assert!(words.starts_with("--robot mine.py:Mine: describe: servos: found 5, expected 6, those of "), "{words}");
}
