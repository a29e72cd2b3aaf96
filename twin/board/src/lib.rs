//! The board: results of policies on the benchmark, one file a row.
//!
//! [`entry`] is the file of a row, and [`add`] makes one from finished runs (`runs`). Its parts are the [`settings`] of the runs,
//! their [`outcomes`] by trial, and the [`shares`] that follow from these. [`check`] verifies an entry from its own
//! content, and [`rerun`] runs some of its trials again. [`table`] sorts entries into groups that can be compared, and
//! [`page`] shows them.

pub mod add;
pub mod check;
pub mod entry;
pub mod error;
pub mod outcomes;
pub mod page;
pub mod rerun;
mod runs;
pub mod settings;
pub mod shares;
pub mod table;
#[cfg(test)]
mod test_runs;

pub use add::{EntryText, add};
pub use check::{Difference, verify};
pub use entry::BoardEntry;
pub use error::BoardError;
