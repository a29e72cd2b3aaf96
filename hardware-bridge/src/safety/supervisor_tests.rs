use crate::supported_robot::SERVOS;
use hand_model::gravity::GravityModel;
use hand_model::robot::ArmState;
use hand_model::{Arm, ArmVector};
use proptest::prelude::*;

use super::super::checks::tests::fine;
use super::super::limits::tests::limits;
use super::super::torque_monitor::TorqueLimits;
use super::*;

const DT: f64 = 0.005;

fn armed(now: f64) -> Supervisor {
    let mut supervisor = Supervisor::new(limits());
    supervisor.connect().expect("from disconnected");
    supervisor.check(&fine(now), now).expect("fine");
    supervisor.arm(&fine(now), now).expect("checked");
    supervisor
}

fn winding(current: f64) -> RobotCommand {
    RobotCommand { arm: [0.5; 7].into(), servos: [ServoGoal::Current(current); SERVOS].into(), capture: false }
}

/// Two commands with different times have different numbers.
fn asked(command: &RobotCommand, at: f64) -> Option<ControllerCommand<'_>> {
    Some(ControllerCommand { command, received_at: at, number: at.to_bits() })
}

/// Measurements of a robot whose arm is where it was sent.
fn followed(supervisor: &Supervisor, now: f64) -> Measurements {
    let mut measured = fine(now);
    measured.arm.as_mut().expect("there").state.position = supervisor.sent.arm;
    measured
}

/// Runs `supervisor` with `command` for `cycles` cycles from `now` on, with an arm that follows; returns the last decision
/// and the time.
fn run(supervisor: &mut Supervisor, command: &RobotCommand, cycles: usize, mut now: f64) -> (SupervisorStep, f64) {
    let mut step = SupervisorStep::Silent;
    for _ in 0..cycles {
        now += DT;
        let measured = followed(supervisor, now);
        step = supervisor.step(now, asked(command, now), &measured);
    }
    (step, now)
}

fn sent(step: SupervisorStep) -> SafeCommand {
    match step {
        SupervisorStep::Send(command) => command,
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_way_up_is_in_order_only() {
    let mut supervisor = Supervisor::new(limits());
    assert!(supervisor.check(&fine(0.0), 0.0).is_err());
    supervisor.connect().expect("connects");
    assert_eq!(supervisor.connect().expect_err("twice").to_string(), "cannot connect while connected");
    assert!(supervisor.arm(&fine(0.0), 0.0).is_err(), "not checked");
    assert_eq!(
        supervisor.step(0.1, asked(&winding(0.2), 0.1), &fine(0.1)),
        SupervisorStep::Silent,
        "torque is untouched"
    );
    supervisor.check(&fine(0.2), 0.2).expect("fine");
    let mut hot = fine(0.3);
    hot.servos[1].as_mut().expect("there").state.temperature = 80.0;
    assert!(matches!(supervisor.arm(&hot, 0.3), Err(CheckFailed::Alarm(StopCause::Temperature(1, _)))));
    let first = supervisor.arm(&fine(0.4), 0.4).expect("armed");
    assert_eq!(first.servos[0], SafeGoal { angle: 1.0, current: 0.0 }, "no motion, no force at first");
    assert_eq!(supervisor.step(0.41, None, &fine(0.41)), SupervisorStep::Send(first));
    assert_eq!(supervisor.state(), SupervisorState::Armed);
}

/// A stop before torque is on is not forgotten: the robot must be checked again.
#[test]
fn a_stop_before_the_torque_is_kept() {
    let mut supervisor = Supervisor::new(limits());
    supervisor.connect().expect("connects");
    supervisor.check(&fine(0.0), 0.0).expect("fine");
    supervisor.hold(StopCause::Operator);
    let refused = supervisor.arm(&fine(0.1), 0.1).expect_err("stopped").to_string();
    assert_eq!(refused, "cannot arm while connected");
}

/// An arm that presses is stopped with a named cause and yields: it is sent to its measured posture and no longer to
/// its goal. So is one that presses during a hold of another cause.
#[test]
fn an_arm_that_presses_gives_way() {
    let press = TorqueLimits {
        torque: [30.0; 7].into(),
        residual: [10.0; 7].into(),
        payload: 0.0,
        jolt_time: 0.02,
        torque_time: 0.02,
    };
    let mut limits = SafetyLimits { torque: Some(press), ..limits() };
    limits.arm.angle = [(-7.0, 7.0); 7].into();
    let robot = RobotModel::ftac_gen3();
    let mut supervisor = Supervisor::new(limits).with_monitors(&robot);
    let model = GravityModel::new(&robot);
    let feeling = |now: f64, position: ArmVector, more: f64| {
        let mut measured = fine(now);
        let mut torque: [f64; 7] = model.torques_at_acceleration(&robot.arm.tree.forward(&position), &[0.0; 7]).into();
        torque[3] += more;
        let arm = measured.arm.as_mut().expect("there");
        arm.state = ArmState { position, velocity: [0.0; 7].into(), torque: torque.into() };
        measured
    };
    let (home, mut beyond) = (Arm::gen3().home, Arm::gen3().home);
    beyond[3] -= 0.03;
    let command = RobotCommand { arm: beyond, ..winding(0.1) };
    supervisor.connect().expect("connects");
    supervisor.check(&feeling(0.0, home, 0.0), 0.0).expect("fine");
    supervisor.arm(&feeling(0.0, home, 0.0), 0.0).expect("checked");
    let mut now = 0.0;
    let mut step = |supervisor: &mut Supervisor, more: f64, cycles: usize| {
        let mut last = SupervisorStep::Silent;
        for _ in 0..cycles {
            now += DT;
            last = supervisor.step(now, asked(&command, now), &feeling(now, home, more));
        }
        sent(last).arm
    };
    assert_eq!(step(&mut supervisor, 9.0, 60), beyond, "pressed, within the limit");
    assert_eq!(step(&mut supervisor, 12.0, 3), beyond, "a jolt");
    assert_eq!(supervisor.state(), SupervisorState::Running);
    let given_way = step(&mut supervisor, 12.0, 20);
    assert!(
        matches!(supervisor.state(), SupervisorState::Hold(StopCause::ArmResidual(3, torque)) if torque > 10.0 && torque < 12.0)
    );
    assert_eq!(given_way, home, "where it is measured to be");
    let words = supervisor.state().to_string();
    assert!(
        words.contains("arm joint 4: 1") && words.contains("N m more than weight, motion and payload explain"),
        "{words}"
    );
}

#[test]
fn follows_within_speed_and_current() {
    let mut supervisor = armed(0.0);
    let step = supervisor.step(DT, asked(&winding(2.0), DT), &fine(DT));
    let goal = sent(step).servos[0];
    assert!((goal.angle - (1.0 + 6.0 * DT)).abs() < 1e-12 && goal.current == 0.6, "{goal:?}");
    assert!((sent(step).arm[0] - DT).abs() < 1e-12);
    assert_eq!(supervisor.state(), SupervisorState::Running);
}

/// Each alarm ends in hold, keeps the goals, and accepts no new ones.
#[test]
fn hold_keeps_what_is_held() {
    type Change = fn(&mut Measurements);
    let changes: [(Change, StopCause); 5] = [
        (|m| m.servos[3].as_mut().expect("there").received_at = -1.0, StopCause::ServoSilent(3, 0.0)),
        (|m| m.servos[0].as_mut().expect("there").state.temperature = 75.0, StopCause::Temperature(0, 75.0)),
        (|m| m.servos[5].as_mut().expect("there").voltage = Some(5.0), StopCause::Voltage(5, 5.0)),
        (|m| m.arm = None, StopCause::ArmSilent(0.0)),
        (|m| m.cameras = false, StopCause::CamerasGone),
    ];
    for (change, cause) in changes {
        let mut supervisor = armed(0.0);
        let (before, now) = run(&mut supervisor, &winding(0.3), 100, 0.0);
        let mut measured = fine(now + DT);
        change(&mut measured);
        let step = supervisor.step(now + DT, asked(&winding(-0.3), now + DT), &measured);
        assert_eq!(sent(step), sent(before), "{cause}");
        let SupervisorState::Hold(found) = supervisor.state() else { panic!("{}", supervisor.state()) };
        assert_eq!(std::mem::discriminant(&found), std::mem::discriminant(&cause));
        let (later, _) = run(&mut supervisor, &winding(-0.3), 50, now + DT);
        assert_eq!(sent(later), sent(before), "a hold ends only by a request");
    }
}

/// An arm that stands outside its range would jump into it: torque is not switched on.
#[test]
fn an_arm_outside_its_range_is_not_armed() {
    let mut supervisor = Supervisor::new(limits());
    supervisor.connect().expect("connects");
    for (angle, armed) in [(2.005, true), (2.1, false), (f64::NAN, false)] {
        let mut supervisor = supervisor.clone();
        let mut measured = fine(0.0);
        supervisor.check(&measured, 0.0).expect("fine");
        assert!(supervisor.state() == SupervisorState::Checked);
        measured.arm.as_mut().expect("there").state.position[1] = angle;
        let first = supervisor.arm(&measured, 0.0);
        match first {
            Ok(first) => assert!(armed && (first.arm[1] - 2.0).abs() < 1e-12, "{angle}"),
            Err(error) => assert!(!armed && matches!(error, CheckFailed::Alarm(StopCause::ArmAngle(1, ..))), "{error}"),
        }
    }
}

/// An arm that does not follow, or that moves by itself, is stopped before it is a tenth of a radian and a bit off.
#[test]
fn an_arm_off_its_course_is_stopped() {
    type Motion = fn(f64) -> f64;
    let frozen: Motion = |_| 0.0;
    let runaway: Motion = |now| -0.9 * now;
    for moves in [frozen, runaway] {
        let mut supervisor = armed(0.0);
        let mut now = 0.0;
        for _ in 0..3 {
            now += DT;
            supervisor.step(now, asked(&winding(0.1), now), &fine(now));
        }
        assert_eq!(supervisor.state(), SupervisorState::Running);
        while supervisor.state() == SupervisorState::Running && now < 2.0 {
            now += DT;
            let mut measured = followed(&supervisor, now);
            measured.arm.as_mut().expect("there").state.position[4] = moves(now);
            supervisor.step(now, asked(&winding(0.1), now), &measured);
        }
        let SupervisorState::Hold(StopCause::ArmOffCourse(4, off)) = supervisor.state() else {
            panic!("{}", supervisor.state())
        };
        assert!((0.1..0.12).contains(&off) && now < 0.35, "{off} rad at {now} s");
        // It is not pulled back to its set-points: it yields to where it is.
        let place = moves(now);
        for _ in 0..400 {
            now += DT;
            let mut measured = followed(&supervisor, now);
            measured.arm.as_mut().expect("there").state.position[4] = place;
            supervisor.step(now, asked(&winding(0.1), now), &measured);
        }
        assert!((supervisor.sent.arm[4] - place).abs() < 1e-9, "{}", supervisor.sent.arm[4]);
    }
}

/// A hold brakes the arm from the speed at which it moves, regardless of its cause; a joint at rest stays at its
/// set-point.
#[test]
fn a_hold_brakes_the_arm() {
    let mut supervisor = armed(0.0);
    let (before, mut now) = run(&mut supervisor, &winding(0.3), 100, 0.0);
    let mut measured = followed(&supervisor, now);
    measured.arm.as_mut().expect("there").state.velocity[0] = 0.8;
    supervisor.hold(StopCause::Operator);
    let mut steps = Vec::new();
    let mut at = sent(before).arm;
    for _ in 0..40 {
        now += DT;
        let command = winding(-0.3);
        measured.servos = fine(now).servos;
        measured.arm.as_mut().expect("there").received_at = now;
        let next = sent(supervisor.step(now, asked(&command, now), &measured)).arm;
        steps.push((next[0] - at[0]) / DT);
        at = next;
    }
    // 8 rad/s2 for 5 ms is 0.04 rad/s; measured speeds after the first do not count.
    assert!((steps[0] - 0.76).abs() < 1e-9 && (steps[1] - 0.72).abs() < 1e-9, "{steps:?}");
    assert!(steps[20..].iter().all(|speed| *speed == 0.0), "{steps:?}");
    assert_eq!(at[1], sent(before).arm[1]);
}

#[test]
fn alerts_are_faults() {
    let mut supervisor = armed(0.0);
    let (before, now) = run(&mut supervisor, &winding(0.5), 100, 0.0);
    let mut measured = fine(now + DT);
    measured.servos[2].as_mut().expect("there").alert = true;
    let step = supervisor.step(now + DT, asked(&winding(0.5), now + DT), &measured);
    assert_eq!(supervisor.state(), SupervisorState::Fault(StopCause::ServoAlert(2)));
    assert_eq!(sent(step).servos[0], SafeGoal { current: 0.4, ..sent(before).servos[0] }, "capped at the hold current");
}

#[test]
fn the_host_watchdog() {
    let mut supervisor = armed(0.0);
    let (_, now) = run(&mut supervisor, &winding(0.3), 10, 0.0);
    let command = winding(0.3);
    supervisor.step(now + 0.49, asked(&command, now), &fine(now + 0.49));
    assert_eq!(supervisor.state(), SupervisorState::Running);
    supervisor.step(now + 0.51, asked(&command, now), &fine(now + 0.51));
    assert!(matches!(supervisor.state(), SupervisorState::Hold(StopCause::HostSilent(_))), "{}", supervisor.state());
}

#[test]
fn no_number_no_motion() {
    for bad in [
        RobotCommand { arm: [f64::NAN; 7].into(), ..winding(0.1) },
        winding(f64::INFINITY),
        RobotCommand {
            servos: [ServoGoal::Position { angle: 1.0, current_limit: -0.1 }; SERVOS].into(),
            ..winding(0.0)
        },
    ] {
        let mut supervisor = armed(0.0);
        let (before, now) = run(&mut supervisor, &winding(0.2), 20, 0.0);
        let step = supervisor.step(now + DT, asked(&bad, now + DT), &fine(now + DT));
        assert_eq!((step, supervisor.state()), (before, SupervisorState::Hold(StopCause::BadCommand)));
    }
}

/// Release: the current fades evenly, then the torque is switched off; afterwards nothing is sent.
#[test]
fn release_fades_and_ends_without_torque() {
    let mut supervisor = armed(0.0);
    let (_, mut now) = run(&mut supervisor, &winding(0.3), 100, 0.0);
    supervisor.release(now).expect("torque is on");
    let mut currents = vec![];
    let end = loop {
        now += DT;
        match supervisor.step(now, asked(&winding(0.3), now), &fine(now)) {
            SupervisorStep::Send(command) => currents.push(command.servos[0].current),
            other => break other,
        }
    };
    assert_eq!((end, supervisor.state()), (SupervisorStep::TorqueOff, SupervisorState::Connected));
    assert!(currents.windows(2).all(|pair| pair[1] <= pair[0] && pair[0] - pair[1] < 0.01), "{currents:?}");
    assert_eq!(*currents.last().expect("some"), 0.0);
    assert_eq!(supervisor.step(now + DT, asked(&winding(0.3), now), &fine(now + DT)), SupervisorStep::Silent);
}

/// Any action of a controller, a device or an operator.
#[derive(Debug, Clone)]
enum Move {
    Ask(Box<RobotCommand>),
    Disturb(usize, f64),
    Silence(usize),
    Alert(usize),
    Wait(f64),
    Hold,
    Release,
    ReArm,
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![8 => -3.0..8.0_f64, 1 => any::<f64>(), 1 => Just(f64::NAN)]
}

fn servo_goal() -> impl Strategy<Value = ServoGoal> {
    prop_oneof![
        number().prop_map(ServoGoal::Current),
        (number(), number()).prop_map(|(angle, current_limit)| ServoGoal::Position { angle, current_limit }),
    ]
}

fn moves() -> impl Strategy<Value = Move> {
    prop_oneof![
        12 => (prop::array::uniform7(number()), prop::array::uniform6(servo_goal()))
            .prop_map(|(arm, servos)| Move::Ask(Box::new(RobotCommand { arm: ArmVector::from(arm), servos: servos.into(), capture: false }))),
        12 => (-3.0..8.0_f64, 0.0..0.7_f64).prop_map(|(angle, current)| {
            let servos = [ServoGoal::Position { angle, current_limit: current }; SERVOS];
            Move::Ask(Box::new(RobotCommand { arm: [angle; 7].into(), servos: servos.into(), capture: false }))
        }),
        2 => (0..SERVOS, number()).prop_map(|(n, angle)| Move::Disturb(n, angle)),
        1 => (0..SERVOS).prop_map(Move::Silence),
        1 => (0..SERVOS).prop_map(Move::Alert),
        2 => (0.0..1.0_f64).prop_map(Move::Wait),
        1 => Just(Move::Hold),
        1 => Just(Move::Release),
        4 => Just(Move::ReArm),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// No command is ever outside its limits, no goal jumps and no grip is lost in a hold, for any sequence of events.
    #[test]
    fn no_command_ever_outside_limits(moves in prop::collection::vec(moves(), 1..120)) {
        let limits = limits();
        let mut supervisor = armed(0.0);
        let mut now = 0.0;
        let mut last: Option<SafeCommand> = None;
        let mut command = winding(0.1);
        let mut spoken = 0.0;
        for one in moves {
            let mut measured = fine(now);
            match one {
                Move::Ask(asked) => (command, spoken) = (*asked, now),
                Move::Disturb(n, angle) => measured.servos[n].as_mut().expect("there").state.position = angle,
                Move::Silence(n) => measured.servos[n] = None,
                Move::Alert(n) => measured.servos[n].as_mut().expect("there").alert = true,
                Move::Wait(time) => now += time,
                Move::Hold => supervisor.hold(StopCause::Operator),
                Move::Release => drop(supervisor.release(now)),
                Move::ReArm => {
                    if supervisor.state() == SupervisorState::Connected {
                        supervisor.check(&measured, now).ok();
                        if supervisor.arm(&measured, now).is_ok() {
                            last = None;
                        }
                    }
                }
            }
            now += DT;
            let before = supervisor.state();
            let step = supervisor.step(now, asked(&command, spoken), &measured);
            let SupervisorStep::Send(sent) = step else { continue };
            for (n, goal) in sent.servos.iter().enumerate() {
                let own = &limits.servos[n];
                prop_assert!((own.angle.0..=own.angle.1).contains(&goal.angle), "{:?}", goal);
                prop_assert!((0.0..=own.current).contains(&goal.current), "{:?}", goal);
                if let Some(last) = last {
                    prop_assert!((goal.angle - last.servos[n].angle).abs() <= own.speed * MAX_TIME_STEP + 1e-9);
                    if matches!(before, SupervisorState::Hold(_) | SupervisorState::Fault(_)) && !matches!(supervisor.state(), SupervisorState::Release { .. }) {
                        prop_assert_eq!(goal.angle, last.servos[n].angle);
                        prop_assert_eq!(goal.current, last.servos[n].current.min(own.hold_current));
                    }
                }
            }
            for (joint, goal) in sent.arm.iter().enumerate() {
                let (low, high) = limits.arm.angle[joint];
                prop_assert!((low..=high).contains(goal));
                if let Some(last) = last {
                    prop_assert!((goal - last.arm[joint]).abs() <= limits.arm.speed[joint] * MAX_TIME_STEP + 1e-9);
                }
            }
            last = Some(sent);
        }
    }
}
