//! Proves at link time that the core's streaming path neither panics nor allocates.
//!
//! Every stage of the registries is exported with all of its sizes, parameters and data from outside, so that the
//! compiler can assume nothing of them. The panic handler calls a function that exists nowhere: the library links only
//! if no panic is left that anything exported can reach. There is no allocator either.
//!
//! What is proven is the machine code that this compiler makes of this source: `tests/it/proof.rs` does it anew for
//! each change.
#![no_std]

mod export;
mod filters;
mod link;
mod representations;
mod rings;
mod slices;
mod statistics;
mod tensor;
mod transforms;
mod wire;

use export::Export;

unsafe extern "C" {
    /// Exists nowhere.
    fn __lobula_panic_reachable() -> !;
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    // SAFETY: never linked.
    unsafe { __lobula_panic_reachable() }
}

/// The linker's root: whoever calls it may call anything that is proven.
#[unsafe(no_mangle)]
pub extern "C" fn lobula_proof(list: usize, index: usize) -> *const () {
    let lists = [
        wire::EXPORTS,
        filters::EXPORTS,
        transforms::EXPORTS,
        transforms::AUGMENTATIONS,
        slices::EXPORTS,
        statistics::EXPORTS,
        representations::EXPORTS,
        rings::EXPORTS,
        link::EXPORTS,
        tensor::EXPORTS,
    ];
    let export = lists.get(list).and_then(|list| list.get(index));
    export.map_or(core::ptr::null(), Export::pointer)
}

/// Another root, to show that the proof would find what no code of ours may do: an index from outside, unchecked.
///
/// # Safety
/// `len` bytes are there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lobula_planted(bytes: *const u8, len: usize, index: usize) -> u8 {
    // SAFETY: the caller's promise.
    let bytes = unsafe { export::slice(bytes, len) };
    bytes[index]
}
