//! Numbers in rows below a header, as text or in binary: those of PLY and PCD files.

use catch_body::InputError;

/// A header is no longer.
const MOST_HEADER_BYTES: usize = 100_000;

/// Encoding of numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// The type of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

/// Splits the header, up to and with the first line for which `is_last` holds, from the rest. Returns its
/// lines and its length in bytes.
pub(crate) fn split_header(bytes: &[u8], is_last: impl Fn(&str) -> bool) -> Option<(Vec<String>, usize)> {
    let head = &bytes[..bytes.len().min(MOST_HEADER_BYTES)];
    let (mut lines, mut at) = (Vec::new(), 0);
    while let Some(length) = head[at..].iter().position(|it| *it == b'\n') {
        let line = String::from_utf8_lossy(&head[at..at + length]).trim().to_owned();
        at += length + 1;
        let last = is_last(&line);
        lines.push(line);
        if last {
            return Some((lines, at));
        }
    }
    None
}

/// Reads one number after the other.
pub(crate) struct Numbers<'a> {
    /// Name of the file in errors.
    pub file: &'a str,
    pub encoding: Encoding,
    /// The whole file.
    pub bytes: &'a [u8],
    /// Place of the next number.
    pub at: usize,
}

impl Numbers<'_> {
    pub fn next(&mut self, kind: Number) -> Option<f64> {
        if self.encoding == Encoding::Text {
            let word = self.word()?;
            let number = std::str::from_utf8(&self.bytes[word.clone()]).ok()?.parse().ok()?;
            self.at = word.end;
            return Some(number);
        }
        Some(match kind {
            Number::I8 => f64::from(i8::from_le_bytes(self.binary()?)),
            Number::U8 => f64::from(u8::from_le_bytes(self.binary()?)),
            Number::I16 => f64::from(i16::from_le_bytes(self.binary()?)),
            Number::U16 => f64::from(u16::from_le_bytes(self.binary()?)),
            Number::I32 => f64::from(i32::from_le_bytes(self.binary()?)),
            Number::U32 => f64::from(u32::from_le_bytes(self.binary()?)),
            Number::I64 => i64::from_le_bytes(self.binary()?) as f64,
            Number::U64 => u64::from_le_bytes(self.binary()?) as f64,
            Number::F32 => f64::from(f32::from_le_bytes(self.binary()?)),
            Number::F64 => f64::from_le_bytes(self.binary()?),
        })
    }

    fn binary<const N: usize>(&mut self) -> Option<[u8; N]> {
        let mut bytes: [u8; N] = self.bytes.get(self.at..self.at + N)?.try_into().ok()?;
        self.at += N;
        if self.encoding == Encoding::BigEndian {
            bytes.reverse();
        }
        Some(bytes)
    }

    /// Place of the next word of a text.
    fn word(&self) -> Option<std::ops::Range<usize>> {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|it| !it.is_ascii_whitespace())?;
        let length = rest[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - start);
        Some(self.at + start..self.at + start + length)
    }

    /// The line and the next word of a text.
    fn next_word(&self) -> Option<(String, String)> {
        let word = self.word().filter(|_| self.encoding == Encoding::Text)?;
        let line = self.bytes[..word.start].iter().filter(|it| **it == b'\n').count() + 1;
        let shown: String = String::from_utf8_lossy(&self.bytes[word]).chars().take(60).collect();
        Some((format!("line {line}"), shown))
    }

    /// Fault of row `row` of `rows`, whose numbers are not there.
    pub fn missing(&self, what: &str, row: usize, rows: usize) -> InputError {
        match self.next_word().filter(|(_, word)| word.parse::<f64>().is_err()) {
            Some((line, word)) => InputError::new(self.file, line, format!("`{word}`"), "a number"),
            None => InputError::new(self.file, format!("rows of {what}"), row, format!("the {rows} of the header")),
        }
    }

    /// Checks that no number is left: rows with more of them than the header says are read askew.
    ///
    /// # Errors
    /// If there is one.
    pub fn finish(&self) -> Result<(), InputError> {
        let more = self.bytes.len() - self.at;
        let (field, found) = match (self.next_word(), self.encoding) {
            (Some((line, word)), _) => (line, format!("`{word}`")),
            (None, Encoding::Text) => return Ok(()),
            (None, _) if self.bytes[self.at..].iter().all(u8::is_ascii_whitespace) => return Ok(()),
            (None, _) => ("rows".to_owned(), format!("{more} bytes more")),
        };
        Err(InputError::new(self.file, field, found, "no more than the rows of the header"))
    }
}
