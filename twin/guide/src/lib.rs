//! The guide to the F-TAC twin, as pages that build offline:
//!
//! ```sh
//! cargo doc --workspace --no-deps --open
//! ```
//!
//! | page | for whom |
//! |---|---|
//! | [`concepts`] | what is computed, each equation beside the function that computes it |
//! | [`benchmark`] | you run the benchmark, and read what came out |
//! | [`sweep`] | you have a question that takes many benchmarks: axes, Slurm, Parquet |
//! | [`sensor`] | you own a camera-based tactile sensor |
//! | [`hand`] | you own a hand, or an object that you want grasped |
//! | [`robot`] | you have another arm, a hand of another size or side, or more pads |
//! | [`python`] | you write Python: tactile images, learning environments, your own policy in the benchmark |
//! | [`files`] | what is in each file |
//! | [`troubleshooting`] | something is not as it should be |
//!
//! There is no code in this crate. `tests/tests/guide.rs` runs the commands of the pages, `tests/tests/python.rs` the Python examples.

#[doc = include_str!("../pages/concepts.md")]
pub mod concepts {}

#[doc = include_str!("../pages/benchmark.md")]
pub mod benchmark {}

#[doc = include_str!("../pages/sweep.md")]
pub mod sweep {}

#[doc = include_str!("../pages/sensor.md")]
pub mod sensor {}

#[doc = include_str!("../pages/hand.md")]
pub mod hand {}

#[doc = include_str!("../pages/robot.md")]
pub mod robot {}

#[doc = include_str!("../../python/README.md")]
pub mod python {}

#[doc = include_str!("../pages/files.md")]
pub mod files {}

#[doc = include_str!("../pages/troubleshooting.md")]
pub mod troubleshooting {}
