use super::*;

fn write(servo: &mut EmulatedServo, register: &Register, si: f64) -> Result<(), ServoError> {
    servo.write(register.address, &register.write(si).expect("in range"))
}

fn read(servo: &EmulatedServo, register: &Register) -> f64 {
    register.read(&servo.read(register.address, register.size.into()).expect("readable")).expect("its bytes")
}

fn shaft(position: f64, velocity: f64, current: f64) -> ServoState {
    ServoState { position, velocity, current, temperature: 0.0 }
}

#[test]
fn factory_values() {
    let servo = EmulatedServo::factory(100);
    assert_eq!((servo.id(), servo.baud(), servo.return_delay()), (1, 57_600, 500e-6));
    assert_eq!(read(&servo, &xc330::MODEL_NUMBER), f64::from(xc330::MODEL.number));
    assert_eq!(read(&servo, &xc330::GOAL_CURRENT), 0.91);
}

#[test]
fn eeprom_is_locked_while_torque_is_on() {
    let mut servo = EmulatedServo::provisioned(1, 0);
    write(&mut servo, &xc330::TORQUE_ENABLE, 1.0).expect("on");
    assert_eq!(write(&mut servo, &xc330::ID, 3.0), Err(ServoError::Access));
    write(&mut servo, &xc330::TORQUE_ENABLE, 0.0).expect("off");
    write(&mut servo, &xc330::ID, 3.0).expect("unlocked");
    assert_eq!(servo.id(), 3);
}

#[test]
fn refusals() {
    let mut servo = EmulatedServo::provisioned(1, 0);
    assert_eq!(servo.write(xc330::PRESENT_CURRENT.address, &[0, 0]), Err(ServoError::Access));
    assert_eq!(servo.write(xc330::GOAL_CURRENT.address, &[0]), Err(ServoError::DataLength));
    assert_eq!(servo.write(150, &[0]), Err(ServoError::Access));
    assert_eq!(servo.write(xc330::GOAL_CURRENT.address, &2000_i16.to_le_bytes()), Err(ServoError::DataRange));
    write(&mut servo, &xc330::CURRENT_LIMIT, 0.5).expect("lower");
    assert_eq!(write(&mut servo, &xc330::GOAL_CURRENT, 0.6), Err(ServoError::DataLimit));
    assert_eq!(servo.read(250, 10), Err(ServoError::Access));
    assert_eq!(write(&mut servo, &xc330::OPERATING_MODE, 2.0), Err(ServoError::DataRange));
}

/// A write that fails in one register changes none.
#[test]
fn all_or_nothing() {
    let mut servo = EmulatedServo::provisioned(1, 0);
    let before = read(&servo, &xc330::GOAL_CURRENT);
    let mut block = 100_i16.to_le_bytes().to_vec();
    block.extend(5000_i32.to_le_bytes());
    assert_eq!(servo.write(xc330::GOAL_CURRENT.address, &block), Err(ServoError::DataRange));
    assert_eq!(read(&servo, &xc330::GOAL_CURRENT), before);
}

/// The limits 48 and 52 bind in position mode and in no other.
#[test]
fn position_limits_only_in_position_mode() {
    let mut servo = EmulatedServo::provisioned(1, 0);
    let far = 9000.0 * Unit::Angle.per_count();
    write(&mut servo, &xc330::GOAL_POSITION, far).expect("mode 5 ignores the limits");
    write(&mut servo, &xc330::OPERATING_MODE, 3.0).expect("position mode");
    assert_eq!(write(&mut servo, &xc330::GOAL_POSITION, far), Err(ServoError::DataLimit));
}

#[test]
fn watchdog_trips_holds_and_refuses_goals_until_cleared() {
    let mut servo = EmulatedServo::provisioned(1, 0);
    write(&mut servo, &xc330::TORQUE_ENABLE, 1.0).expect("on");
    write(&mut servo, &xc330::BUS_WATCHDOG, 0.1).expect("100 ms");
    write(&mut servo, &xc330::GOAL_POSITION, 3.0).expect("far");
    servo.feed_watchdog(1.0);
    servo.advance(1.09, 0.01, shaft(1.0, 0.0, 0.1));
    assert!(matches!(servo.applied_goal(), ServoGoal::Position { angle, .. } if (angle - 3.0).abs() < 1e-3));
    servo.advance(1.11, 0.01, shaft(1.0, 0.0, 0.1));
    assert!(read(&servo, &xc330::BUS_WATCHDOG) < 0.0);
    assert!(matches!(servo.applied_goal(), ServoGoal::Position { angle, .. } if (angle - 1.0).abs() < 1e-3));
    assert_eq!(write(&mut servo, &xc330::GOAL_POSITION, 2.0), Err(ServoError::DataRange));
    write(&mut servo, &xc330::BUS_WATCHDOG, 0.0).expect("cleared");
    write(&mut servo, &xc330::GOAL_POSITION, 2.0).expect("again");
}

/// The watchdog counts only while torque is on.
#[test]
fn watchdog_sleeps_without_torque() {
    let mut servo = EmulatedServo::provisioned(1, 0);
    write(&mut servo, &xc330::BUS_WATCHDOG, 0.1).expect("100 ms");
    servo.advance(50.0, 0.01, shaft(0.0, 0.0, 0.0));
    assert!(read(&servo, &xc330::BUS_WATCHDOG) > 0.0);
}

#[test]
fn overload_shuts_down_until_reboot() {
    let mut servo = EmulatedServo::provisioned(1, 0);
    write(&mut servo, &xc330::TORQUE_ENABLE, 1.0).expect("on");
    for step in 0..120 {
        servo.advance(0.01 * f64::from(step), 0.01, shaft(1.0, 0.0, 0.85));
    }
    assert!(servo.alert());
    assert_eq!(servo.applied_goal(), ServoGoal::Current(0.0));
    assert_eq!(write(&mut servo, &xc330::TORQUE_ENABLE, 1.0), Err(ServoError::ResultFail));
    servo.reboot(2.0);
    assert!(!servo.listens(2.2) && servo.listens(2.4));
    servo.advance(2.4, 0.01, shaft(1.0, 0.0, 0.0));
    write(&mut servo, &xc330::TORQUE_ENABLE, 1.0).expect("on again");
}

/// A dip below the voltage limit is an alert and no shutdown (mask 0x34); a brown-out loses RAM.
#[test]
fn voltage_dip_and_brown_out() {
    let mut servo = EmulatedServo::provisioned(1, 0);
    write(&mut servo, &xc330::TORQUE_ENABLE, 1.0).expect("on");
    servo.set_voltage(5.2, 1.0);
    servo.advance(1.0, 0.01, shaft(0.0, 0.0, 0.0));
    assert_eq!(read(&servo, &xc330::HARDWARE_ERROR_STATUS) as u8, hardware_error::VOLTAGE);
    assert_eq!(read(&servo, &xc330::TORQUE_ENABLE), 1.0);
    servo.set_voltage(3.0, 1.1);
    assert!(!servo.listens(1.2));
    servo.set_voltage(11.1, 1.3);
    assert!(!servo.listens(1.4) && servo.listens(1.7));
    assert_eq!(read(&servo, &xc330::TORQUE_ENABLE), 0.0);
}

/// After a reboot the servo knows its angle only within a turn; switching torque on sets the goal to the present
/// position.
#[test]
fn turns_are_forgotten() {
    let mut servo = EmulatedServo::provisioned(1, 3000);
    servo.advance(0.0, 0.01, shaft(4.0, 0.0, 0.0));
    let before = read(&servo, &xc330::PRESENT_POSITION);
    servo.reboot(0.0);
    let after = read(&servo, &xc330::PRESENT_POSITION);
    assert!((before - after - std::f64::consts::TAU).abs() < 1e-9, "{before} {after}");
    write(&mut servo, &xc330::TORQUE_ENABLE, 1.0).expect("on");
    assert!(matches!(servo.applied_goal(), ServoGoal::Position { angle, .. } if (angle - 4.0).abs() < 2e-3));
}

/// Drive mode 1 reverses every sign.
#[test]
fn reverse_mode() {
    let mut servo = EmulatedServo::provisioned(1, 0);
    write(&mut servo, &xc330::DRIVE_MODE, 1.0).expect("reverse");
    servo.advance(0.0, 0.01, shaft(1.0, 0.5, 0.2));
    assert!((read(&servo, &xc330::PRESENT_POSITION) + 1.0).abs() < 2e-3);
    assert!(read(&servo, &xc330::PRESENT_CURRENT) < -0.19);
    write(&mut servo, &xc330::TORQUE_ENABLE, 1.0).expect("on");
    write(&mut servo, &xc330::GOAL_POSITION, -2.0).expect("wind");
    assert!(matches!(servo.applied_goal(), ServoGoal::Position { angle, .. } if (angle - 2.0).abs() < 2e-3));
}
