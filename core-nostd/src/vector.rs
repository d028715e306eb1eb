//! Plain loops, compiled twice: for the target, and for the wider vectors that most x86-64 CPUs of today have.
//!
//! No code of its own for any CPU: the compiler vectorises the one loop there is, so both give the same bits (fused
//! multiply-add is not switched on). Counting by polarity takes 2.1 ms per 1.22 million events with AVX2 and 3.0 without
//! (Sapphire Rapids, one busy core, 2026-11). In no_std, and on other CPUs, what the target is compiled for is all.

/// Does `work`, compiled for AVX2 where the CPU has it. Give it a closure with `#[inline(always)]` that calls nothing
/// which is not: what is not inlined stays as it was compiled.
///
/// ```
/// let numbers = [3u16, 1, 2];
/// let most = lobula_core::vector::widest(
///     #[inline(always)]
///     || numbers.iter().fold(0, |most, number| most.max(*number)),
/// );
/// assert_eq!(most, 3);
/// ```
#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[allow(unsafe_code)] // one call, of code for this CPU: see the module for what it gains
#[inline(always)]
pub fn widest<R>(work: impl FnOnce() -> R) -> R {
    use std::arch::is_x86_feature_detected as has;
    if has!("avx2") && has!("bmi1") && has!("bmi2") {
        // SAFETY: the CPU has all that it is compiled for.
        return unsafe { avx2(work) };
    }
    work()
}

#[cfg(all(target_arch = "x86_64", feature = "std"))]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn avx2<R>(work: impl FnOnce() -> R) -> R {
    work()
}

/// Does `work`, as it was compiled for the target.
#[cfg(not(all(target_arch = "x86_64", feature = "std")))]
#[inline(always)]
pub fn widest<R>(work: impl FnOnce() -> R) -> R {
    work()
}
