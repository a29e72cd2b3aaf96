//! Pickled scenes and episodes: their constructor arguments and all actions since.
//!
//! The simulator's state is not stored. The same start and the same actions give the same bits, so unpickling steps the
//! scene again. It is refused by another version of the package, and if the resulting state differs.

use control::Twist;
use control::action::{Action, ActionLimits, ArmAction, HandAction};
use learning_environment::TactileScene;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::arrays::value_error;

/// Length of an encoded action of any kind: kind and up to 7 numbers of the arm, kind and 6 numbers of the hand.
const ACTION_LENGTH: usize = 15;
/// Codes of the kinds: 0 for a palm twist or tensions, 1 for joint angles or spools.
const KIND_CODES: [f64; 2] = [0.0, 1.0];

/// Version of the package.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// A scene or episode that is stepped, its constructor arguments `arguments`, and all actions so far.
#[derive(Clone)]
pub struct SteppedScene<S, M> {
    pub scene: S,
    pub arguments: M,
    pub actions: Vec<Action>,
    /// True if a robot's own commands have moved it between the actions: it cannot be pickled.
    pub ticked: bool,
}

/// Contents of a pickle beside the constructor arguments: version, actions, and digest of the state that they lead to.
pub type PickledState<'py> = (String, Bound<'py, PyArray2<f64>>, u64);

/// The same contents as read back from a pickle.
pub type UnpickledState<'py> = (String, PyReadonlyArray2<'py, f64>, u64);

fn encode_action(action: &Action) -> [f64; ACTION_LENGTH] {
    let mut row = [0.0; ACTION_LENGTH];
    match &action.arm {
        ArmAction::Twist(twist) => row[1..7].copy_from_slice(twist.as_slice()),
        ArmAction::Joints(joints) => {
            row[0] = KIND_CODES[1];
            row[1..=joints.len()].copy_from_slice(joints);
        }
    }
    match &action.hand {
        HandAction::Tensions { tensions, opposition } => {
            row[9..9 + tensions.len()].copy_from_slice(tensions);
            row[14] = *opposition;
        }
        HandAction::Spools(spools) => {
            row[8] = KIND_CODES[1];
            row[9..9 + spools.len()].copy_from_slice(spools);
        }
    }
    row
}

/// Decodes a row into an action of a robot with these limits.
fn decode_action(row: &[f64], limits: &ActionLimits) -> Action {
    let arm = if row[0] == KIND_CODES[1] {
        ArmAction::Joints(row[1..=limits.joints.len()].iter().copied().collect())
    } else {
        ArmAction::Twist(Twist::from_column_slice(&row[1..7]))
    };
    let hand = if row[8] == KIND_CODES[1] {
        HandAction::Spools(row[9..9 + limits.spools.len()].iter().copied().collect())
    } else {
        HandAction::Tensions { tensions: row[9..9 + limits.digits].iter().copied().collect(), opposition: row[14] }
    };
    Action { arm, hand }
}

/// Returns a digest (FNV-1a) over the bits of all measurements of the robot.
fn state_digest(scene: &TactileScene) -> u64 {
    let servos = scene.servos().iter().flat_map(|servo| [servo.position, servo.velocity, servo.current]);
    let arm = scene.arm();
    let arm = arm.position.iter().chain(&arm.velocity).chain(&arm.torque).copied();
    let numbers = std::iter::once(scene.time()).chain(servos).chain(arm);
    numbers.fold(0xcbf2_9ce4_8422_2325, |hash, number| (hash ^ number.to_bits()).wrapping_mul(0x0100_0000_01b3))
}

/// Returns the contents for the pickle of a scene.
pub fn pickle<'py>(py: Python<'py>, scene: &TactileScene, actions: &[Action]) -> PickledState<'py> {
    let mut table = Array2::zeros((actions.len(), ACTION_LENGTH));
    for (mut line, action) in table.outer_iter_mut().zip(actions) {
        line.iter_mut().zip(encode_action(action)).for_each(|(to, from)| *to = from);
    }
    (VERSION.to_owned(), table.into_pyarray(py), state_digest(scene))
}

/// Decodes the actions of a pickle for `scene`, which has the same constructor arguments. A pickle of another version
/// is refused.
pub fn decode_actions(scene: &TactileScene, given: &UnpickledState) -> PyResult<Vec<Action>> {
    let (version, table, _) = given;
    if version != VERSION {
        return Err(value_error(format!("pickle: found one of ftac {version}, expected one of {VERSION}")));
    }
    if table.shape()[1] != ACTION_LENGTH {
        return Err(value_error(format!("pickle: found shape {:?}, expected {ACTION_LENGTH} columns", table.shape())));
    }
    Ok(table
        .as_slice()
        .map_err(value_error)?
        .chunks_exact(ACTION_LENGTH)
        .map(|row| decode_action(row, scene.limits()))
        .collect())
}

/// Returns an error unless the scene has reached the pickled state.
pub fn check_state(scene: &TactileScene, given: &UnpickledState) -> PyResult<()> {
    if state_digest(scene) == given.2 {
        return Ok(());
    }
    let words = "pickle: the same actions lead to another state here than where it was made: make the scene anew";
    Err(PyRuntimeError::new_err(words))
}
