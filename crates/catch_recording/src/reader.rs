//! Reads recordings.

use std::{
    fs::File,
    io::{self, BufReader, Read, Take},
    marker::PhantomData,
    path::Path,
};

use catch_body::InputError;
use flate2::read::GzDecoder;
use serde::{
    Deserialize,
    de::{DeserializeOwned, IgnoredAny},
};

use crate::{
    bounded_file::FileKind,
    consistency,
    recording::{
        Ending, FORMAT, FORMAT_VERSION, Header, MOST_PART_BYTES, MOST_UNPACKED_BYTES, RecordedTick, most_bytes,
    },
};

/// Description of a valid recording, for error messages.
const EXPECTED: &str = "a recording written by `catchingbot catch` or by a cell's recorder (*.catch)";

/// A part of a recording that the tick loop of a cell does not write, such as the truth of a simulation.
///
/// Who does not care for it reads [`IgnoredAny`].
pub trait Channel: DeserializeOwned {
    /// Checks that its values are consistent; `file` is the recording.
    ///
    /// # Errors
    /// The first inconsistent value.
    fn check(&self, _file: &str) -> Result<(), InputError> {
        Ok(())
    }
}

impl Channel for IgnoredAny {}

/// Fields that the headers of all versions have; they state whether the rest can be read.
#[derive(Deserialize)]
struct Preamble {
    format: String,
    format_version: u32,
    version: String,
}

/// Reads a recording, tick by tick. `S` is read of what a simulation says of itself, `T` of what only it
/// knows.
pub struct RecordingReader<S = IgnoredAny, T = IgnoredAny> {
    file: String,
    input: Input,
    /// Time of the last tick.
    last_s: Option<f64>,
    /// Bytes that the images so far would take as they are written; zeros can be written shorter.
    image_bytes: u64,
    /// Header: all that was given before the throw.
    pub header: Header<S>,
    truth: PhantomData<T>,
}

/// Part of a recording after its header.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part<T> {
    /// The next tick.
    Tick(Box<RecordedTick>),
    /// The end; nothing follows.
    Ending(Box<Ending<T>>),
}

impl<S: Channel, T: Channel> RecordingReader<S, T> {
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
        let header: Header<S> = read(&file, &mut input, false)?;
        consistency::cell(&file, &header.cell)?;
        Ok(Self { file, input, last_s: None, image_bytes: 0, header, truth: PhantomData })
    }

    /// The next part of the recording.
    ///
    /// # Errors
    /// If the file ends before its ending or is damaged.
    pub fn next_part(&mut self) -> Result<Part<T>, InputError> {
        let part = read(&self.file, &mut self.input, false)?;
        match &part {
            Part::Tick(tick) => {
                consistency::tick(&self.file, tick, self.last_s, &self.header.cell.cameras)?;
                self.last_s = Some(tick.observation.time_s);
                self.image_bytes += tick.observation.frames.iter().map(most_bytes).sum::<u64>();
                if self.image_bytes > MOST_UNPACKED_BYTES {
                    return Err(too_large(&self.file));
                }
                return Ok(part);
            }
            Part::Ending(ending) => ending.ground_truth.iter().try_for_each(|it| it.check(&self.file))?,
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

fn too_large(file: &str) -> InputError {
    let [whole, part] = [MOST_UNPACKED_BYTES, MOST_PART_BYTES].map(|it| it >> 20);
    let expected = format!("a recording of at most {whole} MiB unpacked, {part} MiB in a tick");
    InputError::new(file, "size", "more", expected)
}

/// Reads the next part; of a file that is no recording the `first` one cannot be read.
fn read<T: DeserializeOwned>(file: &str, input: &mut Input, first: bool) -> Result<T, InputError> {
    let mut part = input.by_ref().take(MOST_PART_BYTES);
    let read = serde_path_to_error::deserialize(&mut rmp_serde::Deserializer::new(&mut part));
    read.map_err(|fault: serde_path_to_error::Error<rmp_serde::decode::Error>| {
        if part.limit() == 0 || part.get_ref().get_ref().limit() == 0 {
            return too_large(file);
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

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;
    use flate2::{Compression, GzBuilder};

    /// The first format had neither trajectories with identifiers nor headers like these.
    #[test]
    fn an_old_recording_is_refused_by_its_version() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("old.catch");
        let mut out = GzBuilder::new().write(File::create(&path).unwrap(), Compression::fast());
        let header = serde_json::json!({
            "format": FORMAT, "format_version": 3, "version": "0.0.9", "scenario": "something else"
        });
        rmp_serde::encode::write_named(&mut out, &header).unwrap();
        out.finish().unwrap();
        let fault = RecordingReader::<IgnoredAny, IgnoredAny>::open(&path).err().unwrap().to_string();
        assert!(
            fault.contains("format_version: found 3, written by version 0.0.9")
                && fault.contains(&FORMAT_VERSION.to_string()),
            "{fault}"
        );
    }

    /// A file of some hundred kilobytes whose header has a list of 200 million zeros.
    #[test]
    fn what_unpacks_to_far_more_is_not_read_on() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("zeros.catch");
        let mut out = GzBuilder::new().write(File::create(&path).unwrap(), Compression::fast());
        let zeros: u32 = 200_000_000;
        // A map of two, with a list of so many elements.
        out.write_all(&[0x82]).unwrap();
        for text in ["format", FORMAT, "else"] {
            rmp_serde::encode::write(&mut out, text).unwrap();
        }
        out.write_all(&[&[0xdd], &zeros.to_be_bytes()[..]].concat()).unwrap();
        io::copy(&mut io::repeat(0).take(u64::from(zeros)), &mut out).unwrap();
        out.finish().unwrap();
        let fault = RecordingReader::<IgnoredAny, IgnoredAny>::open(&path).err().unwrap().to_string();
        assert!(fault.contains("size: found more, expected a recording of at most 1024 MiB unpacked"), "{fault}");
    }
}
