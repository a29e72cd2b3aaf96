//! Faults that can be injected into an emulated arm.

use rand::{Rng, RngExt};

/// A fault, from now on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Injection {
    /// The base raises the faults of these bits of its bank A.
    BaseFault(u32),
    /// As [`Injection::BaseFault`], but its cause stays: it comes back when faults are cleared. 0 ends it.
    LastingBaseFault(u32),
    /// A joint (from 0) raises the faults of these bits of its bank A.
    JointFault {
        /// From 0.
        joint: usize,
        /// Bits of [`crate::safety_bank::ACTUATOR`].
        bits: u32,
    },
    /// The emergency stop is pressed or let go. Letting it go does not clear the fault.
    EmergencyStop(bool),
    /// A share of the datagrams, 0 to 1, does not arrive at the arm.
    LoseCommands(f64),
    /// A share of the datagrams, 0 to 1, does not arrive at the host.
    LoseReplies(f64),
    /// Datagrams to the host take up to this many ms, each another time, so that they overtake each other.
    DelayReplies(u64),
    /// The arm forgets all sessions, as after a restart.
    ForgetSessions,
    /// The arm neither receives nor sends, on both interfaces.
    Deaf(bool),
    /// A joint (from 0) is put into this control mode by another client.
    ControlMode {
        /// From 0.
        joint: usize,
        /// As the arm numbers them: 1 position, 2 velocity, 3 torque.
        mode: i32,
    },
}

/// Disturbances of the network.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct NetworkFaults {
    pub lose_commands: f64,
    pub lose_replies: f64,
    pub delay: u64,
    pub deaf: bool,
}

impl NetworkFaults {
    pub fn loses_command(&self, random: &mut impl Rng) -> bool {
        self.lose_commands > 0.0 && random.random::<f64>() < self.lose_commands
    }

    pub fn loses_reply(&self, random: &mut impl Rng) -> bool {
        self.lose_replies > 0.0 && random.random::<f64>() < self.lose_replies
    }

    /// ms.
    pub fn delay(&self, random: &mut impl Rng) -> u64 {
        if self.delay == 0 { 0 } else { random.random_range(0..=self.delay) }
    }
}
