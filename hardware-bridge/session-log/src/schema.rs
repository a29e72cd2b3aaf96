//! Protobuf description of the messages. It is part of every file, so that any protobuf reader can read it.
//!
//! It repeats the message types as data. A test reads messages by it and compares.

use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FieldDescriptorProto, FieldOptions, FileDescriptorProto, FileDescriptorSet};

/// Package of the messages.
const PACKAGE: &str = "ftac";

/// Returns the full protobuf name of a message, with its package.
pub fn message_name(message: &str) -> String {
    format!("{PACKAGE}.{message}")
}

enum FieldType {
    One(Type),
    List(Type),
    Messages(&'static str),
}

use FieldType::{List, Messages, One};

type Fields = &'static [(&'static str, FieldType)];

/// Fields in the order of their numbers, from 1.
const MESSAGES: &[(&str, Fields)] = &[
    (
        "Observation",
        &[
            ("time", One(Type::Double)),
            ("sequence", One(Type::Uint64)),
            ("servo_position", List(Type::Double)),
            ("servo_velocity", List(Type::Double)),
            ("servo_current", List(Type::Double)),
            ("servo_temperature", List(Type::Double)),
            ("arm_position", List(Type::Double)),
            ("arm_velocity", List(Type::Double)),
            ("arm_torque", List(Type::Double)),
            ("tactile", Messages("TactileFrame")),
            ("servo_time", List(Type::Double)),
            ("servo_unread", List(Type::Uint32)),
            ("arm_time", One(Type::Double)),
        ],
    ),
    (
        "TactileFrame",
        &[
            ("camera", One(Type::Uint32)),
            ("time", One(Type::Double)),
            ("sequence", One(Type::Uint64)),
            ("rgb", One(Type::Bytes)),
            ("rgb_change", One(Type::Bytes)),
        ],
    ),
    (
        "Command",
        &[
            ("arm", List(Type::Double)),
            ("servo_mode", List(Type::Uint32)),
            ("servo_angle", List(Type::Double)),
            ("servo_current", List(Type::Double)),
            ("capture", One(Type::Bool)),
        ],
    ),
    ("Detection", &[("object", One(Type::Uint32)), ("pose", List(Type::Double)), ("sigma", One(Type::Double))]),
    ("Tick", &[("time", One(Type::Double)), ("lateness", One(Type::Double))]),
];

/// Returns the descriptions of all messages as an encoded `FileDescriptorSet`, for `protoc --descriptor_set_in` and
/// protobuf libraries.
pub fn descriptor_set() -> Vec<u8> {
    let message = |(name, fields): &(&str, Fields)| DescriptorProto {
        name: Some((*name).to_owned()),
        field: (1..).zip(*fields).map(|(number, (name, shape))| field(number, name, shape)).collect(),
        ..Default::default()
    };
    let file = FileDescriptorProto {
        name: Some("ftac.proto".to_owned()),
        package: Some(PACKAGE.to_owned()),
        message_type: MESSAGES.iter().map(message).collect(),
        ..Default::default()
    };
    FileDescriptorSet { file: vec![file] }.encode_to_vec()
}

fn field(number: i32, name: &str, shape: &FieldType) -> FieldDescriptorProto {
    let (label, kind, type_name) = match shape {
        One(kind) => (Label::Optional, *kind, None),
        List(kind) => (Label::Repeated, *kind, None),
        Messages(name) => (Label::Repeated, Type::Message, Some(format!(".{PACKAGE}.{name}"))),
    };
    let options = matches!(shape, List(_)).then(|| FieldOptions { packed: Some(true), ..Default::default() });
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        label: Some(label as i32),
        r#type: Some(kind as i32),
        type_name,
        options,
        ..Default::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{Command, DetectedObject, Observation, Tick};
    use crate::tactile_frame::LastImages;
    use hand_model::robot;
    use prost_reflect::{DescriptorPool, DynamicMessage, Value};

    fn read(name: &str, bytes: &[u8]) -> DynamicMessage {
        let pool = DescriptorPool::decode(descriptor_set().as_slice()).expect("a valid description");
        let descriptor = pool.get_message_by_name(&message_name(name)).expect("described");
        DynamicMessage::decode(descriptor, bytes).expect("decodes")
    }

    fn numbers(message: &DynamicMessage, field: &str) -> Vec<f64> {
        let value = message.get_field_by_name(field).expect("a field");
        value.as_list().expect("a list").iter().filter_map(Value::as_f64).collect()
    }

    /// A reader that knows only the description finds every field, and no unknown one.
    #[test]
    fn description_fits_the_messages() {
        let image = std::sync::Arc::new(robot::TactileImage { rgb: vec![7; 6] });
        let frame = robot::TactileFrame { camera: 2, time: 0.5, sequence: 4, image };
        let mut observation = robot::Observation {
            time: 1.5,
            sequence: 9,
            servos: [robot::ServoState::default(); 6].into(),
            tactile: vec![frame],
            ..Default::default()
        };
        observation.servos[5].temperature = 41.0;
        observation.arm.torque = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, -0.0].into();
        let torque = observation.arm.torque;
        let mut readings = robot::Readings::from(observation);
        readings.servos[1] = None;
        let bytes = Observation::new(&readings, &mut LastImages::new()).encode_to_vec();
        let message = read("Observation", &bytes);
        assert_eq!(numbers(&message, "servo_temperature"), [0.0, 0.0, 0.0, 0.0, 0.0, 41.0]);
        assert_eq!(numbers(&message, "arm_torque"), *torque);
        assert_eq!(message.get_field_by_name("sequence").as_deref(), Some(&Value::U64(9)));
        assert_eq!(message.unknown_fields().count(), 0);
        assert_eq!(message.encode_to_vec(), bytes);

        let goal = robot::ServoGoal::Position { angle: 0.25, current_limit: 0.6 };
        let command = robot::RobotCommand { arm: [0.5; 7].into(), servos: [goal; 6].into(), capture: true };
        let message = read("Command", &Command::from(&command).encode_to_vec());
        assert_eq!(numbers(&message, "servo_angle"), [0.25; 6]);
        assert_eq!(message.get_field_by_name("capture").as_deref(), Some(&Value::Bool(true)));
        assert_eq!(message.unknown_fields().count(), 0);

        let message = read("Detection", &DetectedObject::new(1, Some(&([0.5; 7], Some(0.003)))).encode_to_vec());
        assert_eq!(numbers(&message, "pose"), [0.5; 7]);
        assert_eq!(message.unknown_fields().count(), 0);

        let tick = Tick::from(robot::Tick { time: 2.0, lateness: 0.0 });
        let message = read("Tick", &tick.encode_to_vec());
        assert_eq!(message.get_field_by_name("time").as_deref(), Some(&Value::F64(2.0)));
        assert_eq!(message.unknown_fields().count(), 0);
    }
}
