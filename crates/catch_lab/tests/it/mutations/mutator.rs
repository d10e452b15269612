//! Changes files at random: bytes, numbers, words and lines of text.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// What stands in the place of a number.
const STRANGE: [&str; 28] = [
    "0",
    "-0.0",
    "-1",
    "1e300",
    "-1e300",
    "1e-300",
    "nan",
    "inf",
    "-inf",
    "1e9",
    "-1e9",
    "1e-9",
    "500",
    "1e5",
    "0.5",
    "99999999999999999999",
    "4294967295",
    "9223372036854775807",
    "\"text\"",
    "[]",
    "{}",
    "true",
    "[1]",
    "[1, 2, 3, 4]",
    "1e400",
    "0x7f",
    "1_000",
    "",
];

/// A seeded source of changes.
pub struct Mutator {
    rng: Pcg64,
}

impl Mutator {
    pub fn new(seed: u64) -> Self {
        Self { rng: Pcg64::seed_from_u64(seed) }
    }

    /// A number below `most`, or zero.
    pub fn below(&mut self, most: usize) -> usize {
        if most == 0 { 0 } else { self.rng.random_range(0..most) }
    }

    /// A text with one to three changes.
    pub fn text(&mut self, text: &str) -> Vec<u8> {
        let mut changed = text.to_owned();
        for _ in 0..=self.below(3) {
            changed = match self.below(8) {
                0..=3 => self.number_changed(&changed),
                4 | 5 => self.lines_changed(&changed),
                6 => self.word_changed(&changed),
                _ => return self.bytes(changed.as_bytes()),
            };
        }
        changed.into_bytes()
    }

    fn number_changed(&mut self, text: &str) -> String {
        let is_part = |byte: u8| byte.is_ascii_digit() || b"+-.eE".contains(&byte);
        let bytes = text.as_bytes();
        let starts: Vec<usize> = (0..bytes.len())
            .filter(|&i| {
                (bytes[i].is_ascii_digit() || bytes[i] == b'-')
                    && (i == 0
                        || !(is_part(bytes[i - 1]) || bytes[i - 1].is_ascii_alphabetic() || bytes[i - 1] == b'_'))
            })
            .collect();
        let Some(&start) = starts.get(self.below(starts.len())) else { return text.to_owned() };
        let end = (start..bytes.len()).find(|&i| !is_part(bytes[i])).unwrap_or(bytes.len());
        let strange = match (self.below(3), text[start..end].parse::<f64>()) {
            (0, Ok(number)) => {
                let factors = [-1.0, 1e3, 1e-3, 0.999, 1.5, 1e6];
                (number * factors[self.below(factors.len())]).to_string()
            }
            _ => STRANGE[self.below(STRANGE.len())].to_owned(),
        };
        format!("{}{strange}{}", &text[..start], &text[end..])
    }

    fn lines_changed(&mut self, text: &str) -> String {
        let mut lines: Vec<&str> = text.lines().collect();
        if lines.is_empty() {
            return text.to_owned();
        }
        let (one, two) = (self.below(lines.len()), self.below(lines.len()));
        match self.below(4) {
            0 => drop(lines.remove(one)),
            1 => lines.insert(two, lines[one]),
            2 => lines.swap(one, two),
            _ => lines.truncate(one),
        }
        lines.join("\n") + "\n"
    }

    fn word_changed(&mut self, text: &str) -> String {
        let words: Vec<&str> =
            text.split(|it: char| !(it.is_alphanumeric() || it == '_')).filter(|it| !it.is_empty()).collect();
        let (Some(one), Some(two)) = (words.get(self.below(words.len())), words.get(self.below(words.len()))) else {
            return text.to_owned();
        };
        let at = one.as_ptr() as usize - text.as_ptr() as usize;
        format!("{}{two}{}", &text[..at], &text[at + one.len()..])
    }

    /// Bytes with one to three changes.
    pub fn bytes(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut changed = bytes.to_vec();
        for _ in 0..=self.below(3) {
            let (at, length) = (self.below(changed.len()), self.below(16));
            let end = (at + length).min(changed.len());
            match self.below(6) {
                0 if !changed.is_empty() => changed[at] ^= 1 << self.below(8),
                1 => drop(changed.drain(at..end)),
                2 => changed.truncate(at),
                3 => {
                    let copied = changed[at..end].to_vec();
                    changed.splice(at..at, copied);
                }
                4 => {
                    let random: Vec<u8> = (0..length).map(|_| self.rng.random()).collect();
                    changed.splice(at..at, random);
                }
                _ => {
                    let numbers = [f32::NAN, f32::INFINITY, 1e30, -1e30, 1e-30, 0.0];
                    let number = numbers[self.below(numbers.len())].to_le_bytes();
                    for (place, byte) in changed.iter_mut().skip(at / 4 * 4).zip(number) {
                        *place = byte;
                    }
                }
            }
        }
        changed
    }
}
