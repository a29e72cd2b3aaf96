//! The calls of the arm's services that this client makes.

/// A function of a service.
///
/// # Example
/// ```
/// use kinova_kortex::call::{Call, REFRESH};
///
/// assert_eq!(REFRESH.id(), 0x30001);
/// assert_eq!(Call::from_id(0x30001), REFRESH);
/// assert_eq!(REFRESH.to_string(), "BaseCyclic.Refresh");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Call {
    /// Number of the service, 12 bits.
    pub service: u16,
    /// Number of the function within the service.
    pub function: u16,
}

impl Call {
    /// Returns the identifier `service << 16 | function`, as in the header.
    pub fn id(self) -> u32 {
        u32::from(self.service & 0xFFF) << 16 | u32::from(self.function)
    }

    /// Splits an identifier from the header into service and function.
    pub fn from_id(id: u32) -> Self {
        Self { service: (id >> 16) as u16 & 0xFFF, function: id as u16 }
    }

    const fn new(service: u16, function: u16) -> Self {
        Self { service, function }
    }

    /// Returns the name in the maker's interface, if this client knows the call.
    pub fn name(self) -> Option<&'static str> {
        KNOWN.iter().find(|(call, _)| *call == self).map(|(_, name)| *name)
    }
}

impl std::fmt::Display for Call {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.name() {
            Some(name) => f.write_str(name),
            None => write!(f, "{}.{}", self.service, self.function),
        }
    }
}

macro_rules! calls {
    ($($constant:ident = $service:literal / $function:literal, $name:literal;)*) => {
        $(#[doc = concat!("`", $name, "`")] pub const $constant: Call = Call::new($service, $function);)*
        const KNOWN: &[(Call, &str)] = &[$(($constant, $name)),*];
    };
}

calls! {
    CREATE_SESSION = 1 / 1, "Session.Create";
    CLOSE_SESSION = 1 / 2, "Session.Close";
    KEEP_ALIVE = 1 / 3, "Session.KeepAlive";
    READ_ACTION = 2 / 43, "Base.ReadAction";
    READ_ALL_ACTIONS = 2 / 44, "Base.ReadAllActions";
    EXECUTE_ACTION_FROM_REFERENCE = 2 / 47, "Base.ExecuteActionFromReference";
    EXECUTE_ACTION = 2 / 48, "Base.ExecuteAction";
    PAUSE_ACTION = 2 / 49, "Base.PauseAction";
    STOP_ACTION = 2 / 50, "Base.StopAction";
    RESUME_ACTION = 2 / 51, "Base.ResumeAction";
    UNSUBSCRIBE = 2 / 97, "Base.Unsubscribe";
    ACTION_TOPIC = 2 / 106, "Base.ActionTopic";
    STOP = 2 / 112, "Base.Stop";
    GET_TOOL_POSE = 2 / 115, "Base.GetMeasuredCartesianPose";
    GET_JOINT_ANGLES = 2 / 126, "Base.GetMeasuredJointAngles";
    SEND_JOINT_SPEEDS = 2 / 132, "Base.SendJointSpeeds";
    APPLY_EMERGENCY_STOP = 2 / 145, "Base.ApplyEmergencyStop";
    CLEAR_FAULTS = 2 / 146, "Base.ClearFaults";
    SET_SERVOING_MODE = 2 / 152, "Base.SetServoingMode";
    GET_SERVOING_MODE = 2 / 153, "Base.GetServoingMode";
    SERVOING_MODE_TOPIC = 2 / 154, "Base.ServoingModeTopic";
    GET_ACTUATOR_COUNT = 2 / 171, "Base.GetActuatorCount";
    GET_ARM_STATE = 2 / 175, "Base.GetArmState";
    ARM_STATE_TOPIC = 2 / 176, "Base.ArmStateTopic";
    REFRESH = 3 / 1, "BaseCyclic.Refresh";
    REFRESH_FEEDBACK = 3 / 3, "BaseCyclic.RefreshFeedback";
    GET_DEVICE_TYPE = 9 / 3, "DeviceConfig.GetDeviceType";
    GET_FIRMWARE_VERSION = 9 / 4, "DeviceConfig.GetFirmwareVersion";
    GET_MODEL_NUMBER = 9 / 6, "DeviceConfig.GetModelNumber";
    GET_PART_NUMBER = 9 / 7, "DeviceConfig.GetPartNumber";
    GET_SERIAL_NUMBER = 9 / 8, "DeviceConfig.GetSerialNumber";
    SAFETY_TOPIC = 9 / 28, "DeviceConfig.SafetyTopic";
    GET_CONTROL_MODE = 10 / 6, "ActuatorConfig.GetControlMode";
    READ_ALL_DEVICES = 23 / 1, "DeviceManager.ReadAllDevices";
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every identifier observed on the wire, as listed in the protocol facts.
    #[test]
    fn identifiers() {
        let observed = [
            (CREATE_SESSION, 0x10001),
            (CLOSE_SESSION, 0x10002),
            (KEEP_ALIVE, 0x10003),
            (REFRESH, 0x30001),
            (REFRESH_FEEDBACK, 0x30003),
            (SET_SERVOING_MODE, 0x20098),
            (SEND_JOINT_SPEEDS, 0x20084),
            (APPLY_EMERGENCY_STOP, 0x20091),
            (CLEAR_FAULTS, 0x20092),
            (STOP, 0x20070),
            (GET_ACTUATOR_COUNT, 0x200AB),
            (GET_ARM_STATE, 0x200AF),
            (ACTION_TOPIC, 0x2006A),
            (READ_ALL_ACTIONS, 0x2002C),
            (EXECUTE_ACTION_FROM_REFERENCE, 0x2002F),
            (EXECUTE_ACTION, 0x20030),
        ];
        for (call, id) in observed {
            assert_eq!(call.id(), id, "{call}");
            assert_eq!(Call::from_id(id), call);
        }
    }

    #[test]
    fn unknown_calls_show_their_numbers() {
        assert_eq!(Call::from_id(0x0012_0034).to_string(), "18.52");
        assert_eq!(REFRESH.to_string(), "BaseCyclic.Refresh");
    }
}
