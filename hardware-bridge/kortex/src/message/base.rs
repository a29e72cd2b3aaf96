//! Service 2, the base: modes, faults, measured angles, joint speeds.

include!("generated/base.rs");
