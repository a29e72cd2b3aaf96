//! The native module of the Python package `ftac`.
//!
//! It is a thin door: every function here converts its arguments, calls a library without Python's lock, and converts the answer. What
//! users see, with its documentation, is in `python/ftac`. Bad input is a `ValueError` in the library's own words; what fails otherwise is a
//! `RuntimeError`.
//!
//! [`arrays`] converts numpy arrays, [`worlds`] holds what scenes share, [`scene`] steps them and [`pickled`] keeps what it takes to step them anew; [`hand`], [`optics`], [`touch`] and [`grasps`] are
//! the parts that can be used alone, [`trials`] lets a Python object decide in the benchmark's trials, and [`session`] reads recorded ones.

mod arrays;
mod grasps;
mod hand;
mod optics;
mod pickled;
mod program;
mod scene;
mod session;
mod touch;
mod trials;
mod worlds;

use pyo3::prelude::*;

/// Native part of `ftac`; use the package instead.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::grasps::{collection, repertoire};
    #[pymodule_export]
    use crate::hand::{excursions, forward, hand, jacobian, moment_arms, pad_poses, resting_posture, torques};
    #[pymodule_export]
    use crate::optics::{background, press_heights, press_sphere};
    #[pymodule_export]
    use crate::program::run;
    #[pymodule_export]
    use crate::scene::{Episode, Scene, restored_episode, restored_scene, step_all};
    #[pymodule_export]
    use crate::session::session;
    #[pymodule_export]
    use crate::touch::heights;
    #[pymodule_export]
    use crate::trials::Benchmark;
    #[pymodule_export]
    use crate::worlds::{combinations, objects, robot};
}
