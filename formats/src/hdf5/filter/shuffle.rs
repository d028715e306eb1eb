//! Shuffle (filter 2): first the first bytes of all elements, then the second ones, and so on.

use super::room;

/// Puts the bytes of elements together again. Bytes at the end that make no element stay where they are.
pub(super) fn undo(input: &[u8], output: &mut Vec<u8>, element: usize) -> Option<usize> {
    unshuffle(input, room(output, input.len()), element);
    Some(input.len())
}

/// As [`undo`], in memory of the same length.
pub(super) fn unshuffle(input: &[u8], output: &mut [u8], element: usize) {
    match element {
        0 | 1 => output.copy_from_slice(input),
        2 => fixed(input, output, |[a, b]| zip(a, b)),
        4 => fixed(input, output, |planes| bytemuck::cast(fours(planes))),
        8 => fixed(input, output, |[a, b, c, d, e, f, g, h]| {
            let low: [u32; RUN] = bytemuck::cast(fours([a, b, c, d]));
            let high: [u32; RUN] = bytemuck::cast(fours([e, f, g, h]));
            bytemuck::cast(zip(&low, &high))
        }),
        _ => any(input, output, element),
    }
}

/// Elements put together at once. Compiled for AVX2, whose unpacking stays in each half of a vector, it takes 0.9 ns to 8
/// bytes, and 0.6 as it is (Sapphire Rapids, 2026-11).
const RUN: usize = 64;

/// Pairs of one of each: a loop that every compiler makes vectors of, unlike one over eight planes.
#[inline(always)]
fn zip<T: Copy>(a: &[T; RUN], b: &[T; RUN]) -> [[T; 2]; RUN] {
    std::array::from_fn(|i| [a[i], b[i]])
}

/// The bytes of four planes.
#[inline(always)]
fn fours([a, b, c, d]: [&[u8; RUN]; 4]) -> [[u16; 2]; RUN] {
    let low: [u16; RUN] = bytemuck::cast(zip(a, b));
    let high: [u16; RUN] = bytemuck::cast(zip(c, d));
    zip(&low, &high)
}

#[inline(always)]
fn fixed<const ELEMENT: usize>(
    input: &[u8],
    output: &mut [u8],
    together: impl Fn([&[u8; RUN]; ELEMENT]) -> [[u8; ELEMENT]; RUN],
) {
    let count = input.len() / ELEMENT;
    let (elements, _) = output.as_chunks_mut::<ELEMENT>();
    let (runs, _) = elements.as_chunks_mut::<RUN>();
    for (i, run) in runs.iter_mut().enumerate() {
        let plane = |plane: usize| input.get(plane * count + i * RUN..).and_then(|rest| rest.first_chunk());
        *run = together(std::array::from_fn(|which| plane(which).unwrap_or(&[0; RUN])));
    }
    rest(input, output, ELEMENT, count / RUN * RUN);
}

fn any(input: &[u8], output: &mut [u8], element: usize) {
    rest(input, output, element, 0);
}

/// The elements from this one on, and the bytes that make none.
fn rest(input: &[u8], output: &mut [u8], element: usize, from: usize) {
    let count = input.len() / element;
    for (i, bytes) in output.chunks_exact_mut(element).enumerate().skip(from) {
        for (plane, byte) in bytes.iter_mut().enumerate() {
            *byte = input.get(plane * count + i).copied().unwrap_or_default();
        }
    }
    let end = count * element;
    if let (Some(from), Some(to)) = (input.get(end..), output.get_mut(end..)) {
        to.copy_from_slice(from);
    }
}

/// What a writer does: the bytes of elements apart.
pub(super) fn shuffle(input: &[u8], output: &mut Vec<u8>, element: usize) {
    output.clear();
    for plane in 0..element {
        output.extend(input.iter().skip(plane).step_by(element));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_by_plane() {
        let mut output = Vec::new();
        undo(&[1, 2, 3, 11, 12, 13, 99], &mut output, 2).unwrap();
        assert_eq!(output, [1, 11, 2, 12, 3, 13, 99]);
    }

    #[test]
    fn undoes_what_it_does() {
        for element in [1, 2, 3, 4, 8, 14] {
            for count in [0, 1, 63, 64, 65, 200] {
                let bytes: Vec<u8> = (0..element * count).map(|i| (i * 7 % 251) as u8).collect();
                let (mut apart, mut together) = (Vec::new(), Vec::new());
                shuffle(&bytes, &mut apart, element);
                undo(&apart, &mut together, element).unwrap();
                assert_eq!(together, bytes, "{count} of {element} bytes");
            }
        }
    }
}
