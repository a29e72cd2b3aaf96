//! The native module of the Python package `ftac`.
//!
//! It is a thin layer: every function here converts its arguments, calls a library with Python's lock (GIL) released,
//! and converts the answer. The users' interface, with its documentation, is in `python/ftac`. Bad input raises a
//! `ValueError` with the library's message; other failures raise a `RuntimeError`.
//!
//! [`arrays`] converts numpy arrays, [`shared_benches`] holds the data shared by scenes, [`scene`] steps them, [`batches`]
//! many at once, and [`pickling`] stores the actions with which they can be stepped again. [`hand`], [`optics`], [`touch`] and [`grasps`] can be used
//! alone. [`trials`] lets a Python object decide in the benchmark's trials, and [`session`] reads recorded ones;
//! [`steps`] makes arrays of both. [`threads`] does their work, in forked processes too.

mod arrays;
mod batches;
mod grasps;
mod hand;
mod optics;
mod pickling;
mod program;
mod scene;
mod session;
mod shared_benches;
mod steps;
mod threads;
mod touch;
mod trials;

use pyo3::prelude::*;

/// Native part of `ftac`; use the package instead.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::batches::{step_all, tactile_of_all};
    #[pymodule_export]
    use crate::grasps::{collection, repertoire};
    #[pymodule_export]
    use crate::hand::{
        excursions, forward, friction_compensated, hand, jacobian, moment_arms, pad_poses, resting_posture, torques,
    };
    #[pymodule_export]
    use crate::optics::{background, press_heights, press_sphere};
    #[pymodule_export]
    use crate::program::run;
    #[pymodule_export]
    use crate::scene::{Episode, Scene, restored_episode, restored_scene};
    #[pymodule_export]
    use crate::session::session;
    #[pymodule_export]
    use crate::shared_benches::{
        benchmark_scenario, check_overrides, combinations, objects, robot, scenario, scenario_objects,
    };
    #[pymodule_export]
    use crate::touch::heights;
    #[pymodule_export]
    use crate::trials::Benchmark;

    #[pymodule_init]
    fn init(_module: &pyo3::Bound<'_, pyo3::types::PyModule>) -> pyo3::PyResult<()> {
        crate::threads::remember_process();
        Ok(())
    }
}
