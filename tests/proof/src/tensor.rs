//! The ends of tensors.

use crate::export;
use crate::export::{Export, slice, slice_mut};
use lobula_core::tensor::{
    BadTensor, Element, Histogram, Method, Quantise, Resize, Size, maximum, percentile,
};
use lobula_core::{Shape, f16};

unsafe fn make(at: *mut Resize, from: Shape, to: Size, method: Method) -> Result<Shape, BadTensor> {
    // SAFETY: the caller's promise.
    Resize::try_new(from, to, method).map(|resize| unsafe {
        at.write(resize);
        resize.shape()
    })
}

unsafe fn resize<I: Element, O: Element>(
    resize: *const Resize,
    input: (*const I, usize),
    output: (*mut O, usize),
) -> Result<(), BadTensor> {
    // SAFETY: the caller's promise.
    unsafe { (*resize).apply(slice(input.0, input.1), slice_mut(output.0, output.1)) }
}

unsafe fn quantise<I: Element>(
    quantise: *const Quantise,
    input: (*const I, usize),
    output: (*mut u8, usize),
) -> Result<u64, BadTensor> {
    // SAFETY: the caller's promise.
    unsafe { (*quantise).apply(slice(input.0, input.1), slice_mut(output.0, output.1)) }
}

unsafe fn ranges<I: Element>(
    input: (*const I, usize),
    percent: f32,
    scratch: *mut Histogram,
    found: *mut (f32, f32),
) {
    // SAFETY: the caller's promise.
    unsafe {
        let tensor = slice(input.0, input.1);
        found.write((maximum(tensor), percentile(tensor, percent, &mut *scratch)));
    }
}

macro_rules! ends {
    ($($type:ty),*) => {
        pub const EXPORTS: &[Export] = &[
            export!(make),
            $(
                export!(resize::<$type, f32>),
                export!(resize::<$type, u8>),
                export!(quantise::<$type>),
                export!(ranges::<$type>),
            )*
            export!(resize::<f16, f16>),
        ];
    };
}

ends!(u8, u16, f16, f32);
