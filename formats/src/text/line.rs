//! One line of text.

use super::layout::Layout;
use super::number::Decimal;

/// What a line is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Line {
    Event {
        t_us: i64,
        x: i64,
        y: i64,
        on: bool,
    },
    /// Empty, or a comment.
    Nothing,
    /// Neither.
    Bad,
}

/// What stands between two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Separator {
    /// Spaces and tabs, one or more.
    Space,
    /// This, with or without spaces around it.
    Mark(u8),
}

impl Separator {
    /// The one in a line of numbers or names: a comma or semicolon if there is one.
    pub fn of(line: &[u8]) -> Self {
        let mark = line.iter().find(|byte| matches!(byte, b',' | b';'));
        mark.map_or(Self::Space, |mark| Self::Mark(*mark))
    }

    /// Whether this byte is one.
    #[inline]
    pub fn is(self, byte: u8) -> bool {
        match self {
            Self::Space => matches!(byte, b' ' | b'\t'),
            Self::Mark(mark) => byte == mark,
        }
    }

    /// The fields of a line, without its end.
    pub fn fields(self, line: &[u8]) -> impl Iterator<Item = &[u8]> {
        let line = line.trim_ascii();
        let is_separator = move |byte: &u8| match self {
            Self::Space => byte.is_ascii_whitespace(),
            Self::Mark(mark) => *byte == mark,
        };
        // Several spaces are one separator, several commas are empty fields.
        let keeps = move |field: &&[u8]| self != Self::Space || !field.is_empty();
        line.split(is_separator).filter(keeps).map(<[u8]>::trim_ascii)
    }
}

/// Whether a line without its spaces is a comment; the text of it.
pub(super) fn comment(line: &[u8]) -> Option<&[u8]> {
    match line.trim_ascii() {
        [b'#' | b'%', rest @ ..] => Some(rest.trim_ascii()),
        _ => None,
    }
}

/// Reads a line, with or without its end.
pub(super) fn parse(line: &[u8], layout: &Layout) -> Line {
    if line.trim_ascii().is_empty() || comment(line).is_some() {
        return Line::Nothing;
    }
    event(line, layout).unwrap_or(Line::Bad)
}

pub(super) const POWERS: [u64; 9] = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];

/// Reads the first line of `text` where it is of the usual kind, which is most of them: four numbers of at most 16 plain
/// digits, a fraction only in the time and no finer than a µs. Also tells its length with its end. `None` for any other
/// line, which may still be an event, and where the text ends within 8 bytes of a number.
#[inline]
pub(super) fn plain(text: &[u8], layout: &Layout) -> Option<(Line, usize)> {
    if layout.fields != 4 {
        return None;
    }
    let [t_place, x_place, y_place, p_place] = layout.places;
    let (mut values, mut at) = ([0u64; 4], 0);
    for (i, value) in values.iter_mut().enumerate() {
        let (mut number, mut digits) = eight(text, at)?;
        at += digits;
        if digits == 8 {
            let (rest, more) = eight(text, at)?;
            // Longer numbers are left to the exact reader.
            number = number * POWERS.get(more)? + rest;
            (digits, at) = (digits + more, at + more);
            if more == 8 {
                return None;
            }
        }
        if digits == 0 {
            return None;
        }
        let mut end = *text.get(at)?;
        if i == t_place {
            let mut power = usize::try_from(layout.power).ok()?;
            if end == b'.' {
                let (decimals, count) = eight(text, at + 1)?;
                power = power.checked_sub(count).filter(|_| count > 0)?;
                number = number.checked_mul(*POWERS.get(count)?)?.checked_add(decimals)?;
                at += 1 + count;
                end = *text.get(at)?;
            }
            number = number.checked_mul(*POWERS.get(power)?)?;
        }
        *value = number;
        at += 1;
        if i < 3 {
            if !layout.separator.is(end) {
                return None;
            }
        } else if end == b'\r' && text.get(at) == Some(&b'\n') {
            at += 1;
        } else if end != b'\n' {
            return None;
        }
    }
    let get = |place: usize| values.get(place).and_then(|value| i64::try_from(*value).ok());
    let p = get(p_place)?;
    let line = Line::Event { t_us: get(t_place)?, x: get(x_place)?, y: get(y_place)?, on: p == 1 };
    (p <= 1).then_some((line, at))
}

/// The digits at this place, at most 8: their number, and how many they are. All 8 bytes must be there.
#[inline(always)]
fn eight(text: &[u8], at: usize) -> Option<(u64, usize)> {
    const EACH: u64 = 0x0101_0101_0101_0101;
    let bytes = u64::from_le_bytes(*text.get(at..)?.first_chunk()?);
    // A digit becomes 0 to 9, any other byte something above.
    let digits = bytes ^ (EACH * 0x30);
    let others = (digits | (digits & (EACH * 0x7F)).wrapping_add(EACH * 0x76)) & (EACH * 0x80);
    let count = others.trailing_zeros() as usize / 8;
    if count == 0 {
        return Some((0, 0));
    }
    // Zeros in front, then pairs, fours and all of it: the first digit is in the lowest byte.
    let digits = digits << (64 - 8 * count);
    let pairs = (digits.wrapping_mul(10).wrapping_add(digits >> 8)) & 0x00FF_00FF_00FF_00FF;
    let fours = (pairs.wrapping_mul(100).wrapping_add(pairs >> 16)) & 0x0000_FFFF_0000_FFFF;
    Some(((fours.wrapping_mul(10_000).wrapping_add(fours >> 32)) & 0xFFFF_FFFF, count))
}

fn event(line: &[u8], layout: &Layout) -> Option<Line> {
    let [mut t, mut x, mut y, mut p] = [[].as_slice(); 4];
    let mut fields = 0;
    for (i, field) in layout.separator.fields(line).enumerate() {
        let [t_place, x_place, y_place, p_place] = layout.places;
        match i {
            _ if i == t_place => t = field,
            _ if i == x_place => x = field,
            _ if i == y_place => y = field,
            _ if i == p_place => p = field,
            _ => {}
        }
        fields = i + 1;
    }
    if fields != layout.fields {
        return None;
    }
    let (t_us, _) = Decimal::parse(t)?.scaled(layout.power)?;
    let (x, y) = (Decimal::parse(x)?.integer()?, Decimal::parse(y)?.integer()?);
    Some(Line::Event { t_us, x, y, on: polarity(p)? })
}

/// 0 or 1, -1 or 1, false or true.
pub(super) fn polarity(field: &[u8]) -> Option<bool> {
    if field.eq_ignore_ascii_case(b"true") {
        return Some(true);
    }
    if field.eq_ignore_ascii_case(b"false") {
        return Some(false);
    }
    match Decimal::parse(field)?.integer()? {
        1 => Some(true),
        0 | -1 => Some(false),
        _ => None,
    }
}
