//! Changes files at random: bytes, numbers, words and lines of text, and how often and how deep parts of it
//! stand.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Replacements of a number.
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
    /// True if nothing is changed.
    pub is_idle: bool,
}

/// Numbers of repetitions of a part of a text, and depths of its nesting.
const TIMES: [usize; 5] = [2, 10, 100, 300, 1000];
/// Bytes of a text that was multiplied, at most.
const MOST_BYTES: usize = 500_000;

impl Mutator {
    pub fn new(seed: u64) -> Self {
        Self { rng: Pcg64::seed_from_u64(seed), is_idle: false }
    }

    /// One that leaves everything as it is.
    pub fn idle() -> Self {
        Self { is_idle: true, ..Self::new(0) }
    }

    /// A number below `most`, or zero.
    pub fn below(&mut self, most: usize) -> usize {
        if most == 0 { 0 } else { self.rng.random_range(0..most) }
    }

    /// A text with one to three changes.
    pub fn text(&mut self, text: &str) -> Vec<u8> {
        if self.is_idle {
            return text.as_bytes().to_vec();
        }
        let mut changed = text.to_owned();
        for _ in 0..=self.below(3) {
            changed = match self.below(10) {
                0..=3 => self.number_changed(&changed),
                4 | 5 => self.lines_changed(&changed),
                6 => self.word_changed(&changed),
                7 | 8 => self.multiplied(&changed),
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

    /// A part between brackets or tags, or else a line, many times beside or within itself.
    fn multiplied(&mut self, text: &str) -> String {
        let bytes = text.as_bytes();
        let opens = |&i: &usize| {
            b"[{".contains(&bytes[i]) || bytes[i] == b'<' && bytes.get(i + 1).is_some_and(u8::is_ascii_alphabetic)
        };
        let starts: Vec<usize> = (0..bytes.len()).filter(opens).collect();
        let part = starts.get(self.below(starts.len())).and_then(|&start| Some((start, end_of_part(text, start)?)));
        let (start, end) = part.unwrap_or_else(|| {
            let starts: Vec<usize> = [0].into_iter().chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect();
            let start = starts[self.below(starts.len())];
            (start, text[start..].find('\n').map_or(text.len(), |length| start + length + 1))
        });
        let part = &text[start..end];
        let times = TIMES[self.below(TIMES.len())].min(1 + MOST_BYTES / (1 + part.len()));
        let is_bracket = part.starts_with(['[', '{']);
        let multiplied = match (self.below(2), part.as_bytes().first()) {
            (0, Some(b'[')) => "[".repeat(times) + part + &"]".repeat(times),
            (0, Some(b'{')) => "{\"a\":".repeat(times) + part + &"}".repeat(times),
            (0, Some(b'<')) if part.contains("</") => {
                let head = &part[..part.find('>').map_or(0, |it| it + 1)];
                let name: String =
                    head[1.min(head.len())..].chars().take_while(|it| it.is_alphanumeric() || *it == '_').collect();
                head.repeat(times) + part + &format!("</{name}>").repeat(times)
            }
            _ => vec![part; times].join(if is_bracket { "," } else { "" }),
        };
        format!("{}{multiplied}{}", &text[..start], &text[end..])
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
        if self.is_idle {
            return changed;
        }
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

/// Finds the end of the part that begins with a bracket or a tag.
fn end_of_part(text: &str, start: usize) -> Option<usize> {
    let rest = &text[start..];
    if let Some(tag) = rest.strip_prefix('<') {
        let name = tag.split(|it: char| !(it.is_alphanumeric() || it == '_')).next()?;
        let head = rest.find('>')? + 1;
        let close = format!("</{name}>");
        let end = if rest[..head].ends_with("/>") { head } else { rest.find(&close)? + close.len() };
        return Some(start + end);
    }
    let mut depth = 0_usize;
    for (i, it) in rest.bytes().enumerate() {
        depth = match it {
            b'[' | b'{' => depth + 1,
            b']' | b'}' => depth - 1,
            _ => depth,
        };
        if depth == 0 {
            return Some(start + i + 1);
        }
    }
    None
}

#[test]
fn parts_are_multiplied() {
    assert_eq!(end_of_part("a [1, {2}] b", 2), Some(10));
    assert_eq!(end_of_part("<a><b x='1'/></a>", 3), Some(13));
    assert_eq!(end_of_part("<a><b x='1'/></a>", 0), Some(17));
    let most = (0..100).map(|seed| Mutator::new(seed).multiplied("<a><b/></a>\n[1]\n").len()).max();
    assert!(most > Some(1000));
    assert_eq!(Mutator::idle().text("a = [1]"), b"a = [1]");
}
