//! The widest vector instructions of the machine, chosen at run time.
//!
//! Results do not depend on the choice: the sums and products are the same in the same order, and nothing is fused.

/// Runs `work` compiled for AVX2 where the machine has it. What `work` calls must be inlined into it to gain.
#[cfg(target_arch = "x86_64")]
#[inline]
pub(crate) fn widest<R>(work: impl FnOnce() -> R) -> R {
    match pulp::x86::V3::try_new() {
        Some(simd) => simd.vectorize(work),
        None => work(),
    }
}

/// Runs `work`.
#[cfg(not(target_arch = "x86_64"))]
#[inline]
pub(crate) fn widest<R>(work: impl FnOnce() -> R) -> R {
    work()
}
