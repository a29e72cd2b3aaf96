//! Other people's hosts of the servo bus as clients of our emulator, and their encoders against ours; see `tests/`.
//!
//! `cargo test --release --manifest-path hardware-bridge/other-hosts/Cargo.toml` from the root of the main workspace.
