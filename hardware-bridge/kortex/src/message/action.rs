//! Service 2, the base: actions, which are named motions that the arm carries out by itself.

include!("generated/action.rs");
