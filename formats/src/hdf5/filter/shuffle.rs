//! Shuffle (filter 2): first the first bytes of all elements, then the second ones, and so on.

/// Puts the bytes of elements together again. Bytes at the end that make no element stay where they are.
pub(super) fn undo(input: &[u8], output: &mut Vec<u8>, element: usize) -> Option<()> {
    output.resize(input.len(), 0);
    unshuffle(input, output, element);
    Some(())
}

/// As [`undo`], in memory of the same length.
pub(super) fn unshuffle(input: &[u8], output: &mut [u8], element: usize) {
    match element {
        0 | 1 => output.copy_from_slice(input),
        2 => fixed::<2>(input, output),
        4 => fixed::<4>(input, output),
        8 => fixed::<8>(input, output),
        _ => any(input, output, element),
    }
}

/// Elements taken at once: the bytes of each plane stay in the nearest cache, and the loops have a known length.
const RUN: usize = 32;

fn fixed<const ELEMENT: usize>(input: &[u8], output: &mut [u8]) {
    let count = input.len() / ELEMENT;
    let whole = count / RUN * RUN;
    let (elements, _) = output.as_chunks_mut::<ELEMENT>();
    for (run, elements) in elements.chunks_exact_mut(RUN).enumerate() {
        let mut planes = [[0; RUN]; ELEMENT];
        for (plane, bytes) in planes.iter_mut().enumerate() {
            let at = plane * count + run * RUN;
            if let Some(from) = input.get(at..at + RUN) {
                bytes.copy_from_slice(from);
            }
        }
        let elements: Option<&mut [[u8; ELEMENT]; RUN]> = elements.try_into().ok();
        for (i, element) in elements.into_iter().flatten().enumerate() {
            *element = std::array::from_fn(|plane| planes[plane][i]);
        }
    }
    rest(input, output, ELEMENT, whole);
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
            for count in [0, 1, 31, 32, 33, 100] {
                let bytes: Vec<u8> = (0..element * count).map(|i| (i * 7 % 251) as u8).collect();
                let (mut apart, mut together) = (Vec::new(), Vec::new());
                shuffle(&bytes, &mut apart, element);
                undo(&apart, &mut together, element).unwrap();
                assert_eq!(together, bytes, "{count} of {element} bytes");
            }
        }
    }
}
