//! What a mirror is told of a tick: measurements, the command that was sent, and what the controller believes.

use control::executor::{Executor, Phase, Target};
use control::perception::Felt;
use hand_model::robot::{ArmState, Command, ServoState, TactileFrame};

/// One tick, without any truth: nothing in it can be had from a simulator alone.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    /// Time after the tick, s.
    pub time: f64,
    /// The servos as measured before the command was sent.
    pub servos: &'a [ServoState],
    /// The arm as measured before the command was sent.
    pub arm: &'a ArmState,
    /// The newest image of each camera, whenever it was taken.
    pub images: &'a [TactileFrame],
    /// What was sent, after limits.
    pub sent: &'a Command,
    /// What the controller is doing.
    pub phase: Phase,
    /// Part of the present path that is over, 0 to 1.
    pub progress: f64,
    /// The objects that it takes, in their order, as it means to take them.
    pub targets: &'a [Target],
    /// Where the first object was felt to be, once it was.
    pub felt: Option<&'a Felt>,
}

impl<'a> Seen<'a> {
    /// A tick of `executor` that ended at `time` (s), in which `sent` was sent.
    pub fn of(executor: &'a Executor, time: f64, sent: &'a Command, felt: Option<&'a Felt>) -> Self {
        Self {
            time,
            servos: executor.motion().servos(),
            arm: executor.motion().arm(),
            images: executor.motion().newest_images(),
            sent,
            phase: executor.phase(),
            progress: executor.motion().progress(),
            targets: executor.targets(),
            felt,
        }
    }
}
