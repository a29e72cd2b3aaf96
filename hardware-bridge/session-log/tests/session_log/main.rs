//! Sessions written, killed, cut, damaged, read by others, and replayed.

mod damage;
mod kill;
mod other_readers;
mod replay;
mod support;
