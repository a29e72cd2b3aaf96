//! Refusals of calls: an error class and a reason.

use prost::Message;

use crate::frame::Frame;
use crate::message::ErrorMessage;

/// Reason for which a call was refused, as far as a caller may want to act on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// The arm does not have this function.
    Unsupported,
    /// The arm does not accept the argument.
    InvalidParameter,
    /// The arm does not know the session: it timed out, or the arm restarted.
    InvalidSession,
    /// The user is unknown, or the password is wrong.
    Login,
    /// Another session is in control.
    NotInControl,
    /// The arm is starting, or is being updated or serviced.
    NotReady,
    /// A fault is active.
    InFault,
    /// The emergency stop is active.
    EmergencyStop,
    /// The call needs another servoing mode.
    ServoingMode,
    /// A joint would leave its range.
    JointLimit,
    /// The motion has too many or too few joints, or is too fast or too long.
    Motion,
    /// Any other reason.
    Other,
}

impl Reason {
    fn from_sub_code(sub_code: u32) -> Self {
        match sub_code {
            2 | 4 | 5 | 46 => Self::Unsupported,
            3 | 13 | 17 | 48 | 49 | 52 => Self::InvalidParameter,
            12 => Self::InvalidSession,
            15 | 16 => Self::Login,
            54 | 130 => Self::NotInControl,
            21 | 23 | 24 | 51 => Self::NotReady,
            22 | 53 => Self::InFault,
            25 => Self::EmergencyStop,
            26 | 27 | 64 | 75 => Self::ServoingMode,
            65 => Self::JointLimit,
            57..=61 | 63 => Self::Motion,
            _ => Self::Other,
        }
    }
}

/// Refusal of a call by the arm.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// The reason, independent of the wire format.
    pub reason: Reason,
    /// The arm's error class: 1 and 2 protocol, 3 device, 4 internal.
    pub code: u32,
    /// Number of the reason, as the arm counts it.
    pub sub_code: u32,
    /// Text by the arm, possibly empty.
    pub text: String,
}

impl Refusal {
    /// Returns the refusal in a response; `None` if the response is not a refusal.
    pub fn of(response: &Frame) -> Option<Self> {
        if response.header.error == 0 {
            return None;
        }
        // The payload repeats the header's numbers and adds a text; the header alone is enough.
        let text = ErrorMessage::decode(response.payload.as_slice()).map(|message| message.text).unwrap_or_default();
        let sub_code = u32::from(response.header.sub_error);
        Some(Self { reason: Reason::from_sub_code(sub_code), code: u32::from(response.header.error), sub_code, text })
    }
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let why = match self.reason {
            Reason::Unsupported => "not supported",
            Reason::InvalidParameter => "argument refused",
            Reason::InvalidSession => "session unknown",
            Reason::Login => "wrong user or password",
            Reason::NotInControl => "another session is in control",
            Reason::NotReady => "the arm is not ready",
            Reason::InFault => "a fault is active",
            Reason::EmergencyStop => "the emergency stop is active",
            Reason::ServoingMode => "wrong servoing mode",
            Reason::JointLimit => "a joint would leave its range",
            Reason::Motion => "motion refused",
            Reason::Other => "refused",
        };
        write!(f, "{why} (code {}, sub-code {})", self.code, self.sub_code)?;
        if self.text.is_empty() { Ok(()) } else { write!(f, ": {}", self.text) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::call;
    use crate::frame::{FrameKind, Header};

    #[test]
    fn header_decides_and_text_is_added() {
        let header = Header {
            kind: FrameKind::Response,
            device: 0,
            error: 3,
            sub_error: 75,
            session: 1,
            message: 1,
            call: call::REFRESH,
        };
        let payload = ErrorMessage { code: 3, sub_code: 75, text: "must be low level".to_owned() }.encode_to_vec();
        let refusal = Refusal::of(&Frame { header, payload }).expect("refused");
        assert_eq!(refusal.reason, Reason::ServoingMode);
        assert_eq!(refusal.to_string(), "wrong servoing mode (code 3, sub-code 75): must be low level");
        let fine = Header { error: 0, sub_error: 0, ..header };
        assert_eq!(Refusal::of(&Frame { header: fine, payload: vec![] }), None);
    }
}
