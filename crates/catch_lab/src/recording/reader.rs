//! Reads recordings.

use std::{
    fs::File,
    io::{self, BufReader, Read, Take},
    path::Path,
};

use catch_body::InputError;
use flate2::read::GzDecoder;
use serde::{Deserialize, de::DeserializeOwned};

use super::{Ending, FORMAT, FORMAT_VERSION, Header, Preamble, RecordedTick, consistency};
use crate::bounded_file::FileKind;

/// What every reader wants.
const EXPECTED: &str = "a recording written by `catchingbot catch` or by a cell's recorder (*.catch)";
/// Bytes of an unpacked recording at most.
pub const MOST_UNPACKED_BYTES: u64 = 1 << 30;

/// Reads a recording, tick by tick.
pub struct RecordingReader {
    file: String,
    input: Input,
    /// When the last tick was.
    last_s: Option<f64>,
    /// What was known before the throw.
    pub header: Header,
}

/// What follows the header.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// The next tick.
    Tick(Box<RecordedTick>),
    /// The end; nothing follows.
    Ending(Box<Ending>),
}

impl RecordingReader {
    /// Opens a recording and reads its header.
    ///
    /// # Errors
    /// If there is no such file, it is not a recording, or a recording of another version.
    pub fn open(path: &Path) -> Result<Self, InputError> {
        let file = path.display().to_string();
        let Preamble { format, format_version, version } = read(&file, &mut open(path)?, true)?;
        if format != FORMAT {
            return Err(InputError::new(&file, "format", format, FORMAT));
        }
        if format_version != FORMAT_VERSION {
            let found = format!("{format_version}, written by version {version}");
            return Err(InputError::new(&file, "format_version", found, FORMAT_VERSION));
        }
        let mut input = open(path)?;
        let header: Header = read(&file, &mut input, false)?;
        consistency::header(&file, &header)?;
        Ok(Self { file, input, last_s: None, header })
    }

    /// The next part of the recording.
    ///
    /// # Errors
    /// If the file ends before its ending or is damaged.
    pub fn next_part(&mut self) -> Result<Part, InputError> {
        let part = read(&self.file, &mut self.input, false)?;
        match &part {
            Part::Tick(tick) => {
                consistency::tick(&self.file, tick, self.last_s, &self.header.cell.cameras)?;
                self.last_s = Some(tick.observation.time_s);
                return Ok(part);
            }
            Part::Ending(ending) => consistency::ending(&self.file, ending)?,
        }
        // Reading on to the end checks the checksum, too.
        let rest = io::copy(&mut self.input.by_ref().take(1), &mut io::sink());
        if rest.as_ref().is_ok_and(|&bytes| bytes == 0) {
            return Ok(part);
        }
        let found = rest.map_or_else(|fault| fault.to_string(), |_| "more data after its end".to_owned());
        Err(InputError::new(&self.file, "the file", found, "the end of the recording"))
    }
}

/// An unpacked recording, as far as it may go.
type Input = BufReader<Take<GzDecoder<BufReader<File>>>>;

/// Opens a packed recording.
fn open(path: &Path) -> Result<Input, InputError> {
    let packed = FileKind::recorded(EXPECTED).open(path)?;
    Ok(BufReader::new(GzDecoder::new(BufReader::new(packed)).take(MOST_UNPACKED_BYTES)))
}

/// Reads the next part; of a file that is no recording the `first` one cannot be read.
fn read<T: DeserializeOwned>(file: &str, input: &mut Input, first: bool) -> Result<T, InputError> {
    let read = serde_path_to_error::deserialize(&mut rmp_serde::Deserializer::new(&mut *input));
    read.map_err(|fault: serde_path_to_error::Error<rmp_serde::decode::Error>| {
        if input.get_ref().limit() == 0 {
            let expected = format!("a recording of at most {} MiB unpacked", MOST_UNPACKED_BYTES >> 20);
            return InputError::new(file, "size", "more", expected);
        }
        let field = fault.path().to_string();
        let fault = fault.into_inner();
        let cut_off = match &fault {
            rmp_serde::decode::Error::InvalidMarkerRead(fault) | rmp_serde::decode::Error::InvalidDataRead(fault) => {
                fault.kind() == io::ErrorKind::UnexpectedEof
            }
            _ => false,
        };
        let is_in_field = field.contains(|it: char| it.is_alphabetic());
        match (first, cut_off) {
            (false, false) if is_in_field => {
                let said = fault.to_string();
                let (found, expected) = said.split_once(", expected ").unwrap_or((&said, "a value of another kind"));
                let found = found.trim_start_matches("invalid value: ").trim_start_matches("found ");
                InputError::new(file, field, found, expected)
            }
            (true, false) => InputError::new(file, "the file", "something else", EXPECTED),
            (_, true) => {
                InputError::new(file, "the file", "an end too early", "a complete recording; this one was cut off")
            }
            (false, false) => InputError::new(file, "the file", fault, "an undamaged recording"),
        }
    })
}
