//! Faults that can be injected into an emulated arm.

use rand::{Rng, RngExt};

/// A fault that lasts from its injection on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Injection {
    /// The base raises the faults of these bits of its bank A.
    BaseFault(u32),
    /// As [`Injection::BaseFault`], but its cause stays: the fault returns when faults are cleared. 0 ends it.
    LastingBaseFault(u32),
    /// A joint (from 0) raises the faults of these bits of its bank A.
    JointFault {
        /// Index of the joint, from 0.
        joint: usize,
        /// Bits of [`crate::safety_bank::ACTUATOR`].
        bits: u32,
    },
    /// The emergency stop is pressed or released. Releasing it does not clear the fault.
    EmergencyStop(bool),
    /// Share of the datagrams that do not arrive at the arm, 0 to 1.
    LoseCommands(f64),
    /// Share of the datagrams that do not arrive at the host, 0 to 1.
    LoseReplies(f64),
    /// Largest delay of datagrams to the host, ms. Each has a delay of its own, so that they overtake each other.
    DelayReplies(u64),
    /// The arm forgets all sessions, as after a restart.
    ForgetSessions,
    /// The arm neither receives nor sends, on both interfaces.
    Deaf(bool),
    /// A joint (from 0) is put into this control mode by another client.
    ControlMode {
        /// Index of the joint, from 0.
        joint: usize,
        /// Control mode as the arm numbers it: 1 position, 2 velocity, 3 torque.
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
    pub(super) fn loses_command(&self, random: &mut impl Rng) -> bool {
        self.lose_commands > 0.0 && random.random::<f64>() < self.lose_commands
    }

    pub(super) fn loses_reply(&self, random: &mut impl Rng) -> bool {
        self.lose_replies > 0.0 && random.random::<f64>() < self.lose_replies
    }

    /// Draws the delay of a datagram, ms.
    pub(super) fn delay(&self, random: &mut impl Rng) -> u64 {
        if self.delay == 0 { 0 } else { random.random_range(0..=self.delay) }
    }
}
