//! Pickled scenes and episodes: what they were made of, and what was asked of them since.
//!
//! The simulator's state is not written: the same beginning and the same actions give the same bits, so that unpickling steps anew. It is refused by
//! another version of the package, and where it does not come out as it was.

use control::Twist;
use control::action::{Action, ActionLimits, ArmAction, HandAction};
use learning_environment::Scene;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::arrays::value_error;

/// Numbers of an action of any kind: kind and up to 7 numbers of the arm, kind and 6 numbers of the hand.
const NUMBERS: usize = 15;
/// Kinds: the palm's velocity or tensions, and joint angles or spools.
const KINDS: [f64; 2] = [0.0, 1.0];

/// The version of the package.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Something with a scene that is stepped; `made` is what it was made of.
#[derive(Clone)]
pub struct Stepped<S, M> {
    pub scene: S,
    pub made: M,
    pub actions: Vec<Action>,
}

/// What a pickle has beside what the scene was made of: its version, the actions, and the state that they lead to.
pub type Kept<'py> = (String, Bound<'py, PyArray2<f64>>, u64);

/// The same as it comes back.
pub type Given<'py> = (String, PyReadonlyArray2<'py, f64>, u64);

fn row(action: &Action) -> [f64; NUMBERS] {
    let mut row = [0.0; NUMBERS];
    match &action.arm {
        ArmAction::Twist(twist) => row[1..7].copy_from_slice(twist.as_slice()),
        ArmAction::Joints(joints) => {
            row[0] = KINDS[1];
            row[1..=joints.len()].copy_from_slice(joints);
        }
    }
    match &action.hand {
        HandAction::Tensions { tensions, opposition } => {
            row[9..9 + tensions.len()].copy_from_slice(tensions);
            row[14] = *opposition;
        }
        HandAction::Spools(spools) => {
            row[8] = KINDS[1];
            row[9..9 + spools.len()].copy_from_slice(spools);
        }
    }
    row
}

/// The action of a robot with these limits.
fn action(row: &[f64], limits: &ActionLimits) -> Action {
    let arm = if row[0] == KINDS[1] {
        ArmAction::Joints(row[1..=limits.joints.len()].iter().copied().collect())
    } else {
        ArmAction::Twist(Twist::from_column_slice(&row[1..7]))
    };
    let hand = if row[8] == KINDS[1] {
        HandAction::Spools(row[9..9 + limits.spools.len()].iter().copied().collect())
    } else {
        HandAction::Tensions { tensions: row[9..9 + limits.digits].iter().copied().collect(), opposition: row[14] }
    };
    Action { arm, hand }
}

/// A digest of everything that the robot measures, by its bits (FNV-1a).
fn state(scene: &Scene) -> u64 {
    let servos = scene.servos().iter().flat_map(|servo| [servo.position, servo.velocity, servo.current]);
    let arm = scene.arm();
    let arm = arm.position.iter().chain(&arm.velocity).chain(&arm.torque).copied();
    let numbers = std::iter::once(scene.time()).chain(servos).chain(arm);
    numbers.fold(0xcbf2_9ce4_8422_2325, |hash, number| (hash ^ number.to_bits()).wrapping_mul(0x0100_0000_01b3))
}

/// For the pickle of a scene.
pub fn keep<'py>(py: Python<'py>, scene: &Scene, actions: &[Action]) -> Kept<'py> {
    let mut table = Array2::zeros((actions.len(), NUMBERS));
    for (mut line, action) in table.outer_iter_mut().zip(actions) {
        line.iter_mut().zip(row(action)).for_each(|(to, from)| *to = from);
    }
    (VERSION.to_owned(), table.into_pyarray(py), state(scene))
}

/// The actions of a pickle of this version, of a scene that was made of the same.
pub fn actions(scene: &Scene, given: &Given) -> PyResult<Vec<Action>> {
    let (version, table, _) = given;
    if version != VERSION {
        return Err(value_error(format!("pickle: found one of ftac {version}, expected one of {VERSION}")));
    }
    if table.shape()[1] != NUMBERS {
        return Err(value_error(format!("pickle: found shape {:?}, expected {NUMBERS} columns", table.shape())));
    }
    Ok(table.as_slice().map_err(value_error)?.chunks_exact(NUMBERS).map(|row| action(row, scene.limits())).collect())
}

/// An error unless the scene has come out as it was.
pub fn check(scene: &Scene, given: &Given) -> PyResult<()> {
    if state(scene) == given.2 {
        return Ok(());
    }
    let words = "pickle: the same actions lead to another state here than where it was made: make the scene anew";
    Err(PyRuntimeError::new_err(words))
}
