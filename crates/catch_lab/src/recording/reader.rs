//! Reads recordings.

use std::{
    fs::File,
    io::{self, BufReader, Read},
    path::Path,
};

use catch_body::InputError;
use flate2::read::GzDecoder;
use serde::{Deserialize, de::DeserializeOwned};

use super::{EXPECTED, Ending, FORMAT, FORMAT_VERSION, Header, Preamble, RecordedTick};

/// Reads a recording, tick by tick.
pub struct RecordingReader {
    file: String,
    input: BufReader<GzDecoder<BufReader<File>>>,
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
        let input = || {
            let opened = File::open(path).map_err(|fault| InputError::new(&file, "the file", fault, EXPECTED))?;
            Ok(BufReader::new(GzDecoder::new(BufReader::new(opened))))
        };
        let Preamble { format, format_version, version } = read(&file, &mut input()?, true)?;
        if format != FORMAT {
            return Err(InputError::new(&file, "format", format, FORMAT));
        }
        if format_version != FORMAT_VERSION {
            let found = format!("{format_version}, written by version {version}");
            return Err(InputError::new(&file, "format_version", found, FORMAT_VERSION));
        }
        let mut input = input()?;
        let header = read(&file, &mut input, true)?;
        Ok(Self { file, input, header })
    }

    /// The next part of the recording.
    ///
    /// # Errors
    /// If the file ends before its ending or is damaged.
    pub fn next_part(&mut self) -> Result<Part, InputError> {
        let part = read(&self.file, &mut self.input, false)?;
        if matches!(part, Part::Tick(_)) {
            return Ok(part);
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

fn read<T: DeserializeOwned>(file: &str, input: &mut impl Read, first: bool) -> Result<T, InputError> {
    rmp_serde::decode::from_read(input).map_err(|fault| {
        let cut_off = match &fault {
            rmp_serde::decode::Error::InvalidMarkerRead(fault) | rmp_serde::decode::Error::InvalidDataRead(fault) => {
                fault.kind() == io::ErrorKind::UnexpectedEof
            }
            _ => false,
        };
        match (first, cut_off) {
            (true, false) => InputError::new(file, "the file", "something else", EXPECTED),
            (_, true) => {
                InputError::new(file, "the file", "an end too early", "a complete recording; this one was cut off")
            }
            (false, false) => InputError::new(file, "the file", fault, "an undamaged recording"),
        }
    })
}
