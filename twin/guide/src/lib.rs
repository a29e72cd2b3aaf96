//! Guide to the F-TAC twin, as pages that build offline:
//!
//! ```sh
//! cargo doc --workspace --no-deps --open
//! ```
//!
//! | page | for readers who |
//! |---|---|
//! | [`concepts`] | want to know what is computed: each equation beside the function that computes it |
//! | [`benchmark`] | run the benchmark and read its results |
//! | [`sweep`] | have a question that takes many benchmarks: axes, Slurm, Parquet |
//! | [`sensor`] | own a camera-based tactile sensor |
//! | [`hand`] | own a hand, or an object to be grasped |
//! | [`robot`] | have another arm, a hand of another size or side, or more pads |
//! | [`python`] | write Python: tactile images, learning environments, their own policy in the benchmark |
//! | [`files`] | look up the contents of a file |
//! | [`troubleshooting`] | have a problem |
//!
//! This crate contains no code. `tests/tests/guide.rs` runs the commands of the pages, `tests/tests/python.rs` the Python examples.

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
