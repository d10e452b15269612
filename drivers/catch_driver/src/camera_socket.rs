//! Images from other processes, over a Unix socket.
//!
//! A sender connects and writes image after image: a header of 36 bytes, little-endian, then the pixels
//! row by row.
//!
//! | bytes | content |
//! |---|---|
//! | 4 | `CBD1` |
//! | 4 | number of the camera in the rig, from zero |
//! | 4 | number of the image, one higher each time |
//! | 8 | capture time in seconds on the host's monotonic clock, a 64-bit float |
//! | 4 + 4 | width and height in pixels |
//! | 4 | format: 1 for 16UC1 (millimetres), 2 for 32FC1 (metres); zero is no depth |
//! | 4 | number of bytes of the pixels |

use std::{
    fmt, fs, io,
    io::{BufReader, ErrorKind, Read},
    os::unix::net::UnixListener,
    path::Path,
    sync::mpsc::{Receiver, Sender, channel},
    thread,
};

use catch_cell::{CameraModel, DepthFrame};
use serde::Serialize;

use crate::clock::Clock;

/// Bytes of the header.
const HEADER: usize = 36;
/// Time from capture to arrival in seconds beyond which an image is late.
const LATE_S: f64 = 0.1;

/// Status of an image as it arrives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameStatus {
    /// Nothing is wrong.
    Fresh,
    /// So many before it did not arrive.
    AfterLost(u32),
    /// It arrived later than a tenth of a second after its capture.
    Late,
    /// It shows the same as the one before, pixel by pixel.
    Frozen,
    /// It was captured before the one that came before it.
    Swapped,
}

/// What was wrong with the images of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct ImageFaults {
    /// Images that did not arrive.
    pub lost: u32,
    /// Images that came late.
    pub late: u32,
    /// Images that repeat the one before.
    pub frozen: u32,
    /// Images older than the one before.
    pub swapped: u32,
    /// Times at which the camera fell silent.
    pub silent: u32,
}

impl ImageFaults {
    /// Counts an image.
    pub fn count(&mut self, status: FrameStatus) {
        match status {
            FrameStatus::Fresh => {}
            FrameStatus::AfterLost(count) => self.lost += count,
            FrameStatus::Late => self.late += 1,
            FrameStatus::Frozen => self.frozen += 1,
            FrameStatus::Swapped => self.swapped += 1,
        }
    }
}

impl fmt::Display for ImageFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { lost, late, frozen, swapped, silent } = self;
        write!(f, "{lost} images lost, {late} late, {frozen} frozen, {swapped} swapped, {silent} times silent")
    }
}

/// An image, its capture time on the host's clock.
#[derive(Debug, Clone, PartialEq)]
pub struct Arrived {
    /// The image.
    pub frame: DepthFrame,
    /// Its status.
    pub status: FrameStatus,
    /// Time from its capture to its arrival in seconds.
    pub latency_s: f64,
}

/// The last image of a camera.
#[derive(Debug, Clone, Default)]
struct Last {
    number: u32,
    capture_s: f64,
    depth_m: Vec<f32>,
}

/// Reads images of the given cameras.
#[derive(Debug)]
pub struct FrameReader<'a> {
    cameras: &'a [CameraModel],
    last: Vec<Option<Last>>,
}

impl<'a> FrameReader<'a> {
    /// A reader that has seen nothing.
    pub fn new(cameras: &'a [CameraModel]) -> Self {
        Self { cameras, last: vec![None; cameras.len()] }
    }

    /// The next image, which arrives now, at `now_s` on the host's clock.
    ///
    /// # Errors
    /// The end of the stream; an image that is none of a camera of the rig, after which nothing can be read.
    pub fn read(&mut self, input: &mut impl Read, now_s: impl Fn() -> f64) -> io::Result<Arrived> {
        let mut header = [0; HEADER];
        input.read_exact(&mut header)?;
        let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        let (camera, number) = (word(4) as usize, word(8));
        let capture_s = f64::from_bits(u64::from(word(12)) | u64::from(word(16)) << 32);
        let [width, height, format, size] = [20, 24, 28, 32].map(word);
        let invalid = |cause: String| io::Error::new(ErrorKind::InvalidData, cause);
        if header[..4] != *b"CBD1" || !capture_s.is_finite() {
            return Err(invalid("no header of an image: found something else, expected CBD1".to_owned()));
        }
        let Some(model) = self.cameras.get(camera) else {
            return Err(invalid(format!("camera: found {camera}, expected less than {}", self.cameras.len())));
        };
        let bytes = match format {
            1 => 2,
            2 => 4,
            _ => return Err(invalid(format!("format of camera {camera}: found {format}, expected 1 or 2"))),
        };
        let expected = (model.width_px, model.height_px, model.width_px * model.height_px * bytes);
        if (width, height, size) != expected {
            let found = (width, height, size);
            return Err(invalid(format!("size of camera {camera}: found {found:?}, expected {expected:?}")));
        }
        let mut pixels = vec![0; size as usize];
        input.read_exact(&mut pixels)?;
        let depth_m: Vec<f32> = match bytes {
            2 => pixels.chunks_exact(2).map(|it| f32::from(u16::from_le_bytes([it[0], it[1]])) * 1e-3).collect(),
            _ => pixels.chunks_exact(4).map(|it| f32::from_le_bytes([it[0], it[1], it[2], it[3]])).collect(),
        };
        let now_s = now_s();
        let status = status(self.last[camera].as_ref(), (number, capture_s, &depth_m), now_s);
        self.last[camera] = Some(Last { number, capture_s, depth_m: depth_m.clone() });
        let frame = DepthFrame { camera, capture_s, window: model.full_window(), depth_m, mask: None };
        Ok(Arrived { frame, status, latency_s: now_s - capture_s })
    }
}

fn status(last: Option<&Last>, (number, capture_s, depth_m): (u32, f64, &[f32]), now_s: f64) -> FrameStatus {
    match last {
        Some(last) if capture_s <= last.capture_s => FrameStatus::Swapped,
        Some(last) if depth_m == last.depth_m => FrameStatus::Frozen,
        _ if now_s > capture_s + LATE_S => FrameStatus::Late,
        Some(last) if number > last.number + 1 => FrameStatus::AfterLost(number - last.number - 1),
        _ => FrameStatus::Fresh,
    }
}

/// Waits at `socket` for senders, each in a thread of its own. What they send wrongly is printed, and they
/// are disconnected.
///
/// # Errors
/// If the socket cannot be made.
pub fn listen(socket: &Path, cameras: &[CameraModel], clock: &Clock) -> io::Result<Receiver<Arrived>> {
    if fs::symlink_metadata(socket).is_ok_and(|it| std::os::unix::fs::FileTypeExt::is_socket(&it.file_type())) {
        fs::remove_file(socket)?;
    }
    let (listener, cameras, clock) = (UnixListener::bind(socket)?, cameras.to_vec(), clock.clone());
    let (arrived, images) = channel();
    thread::spawn(move || {
        for sender in listener.incoming().flatten() {
            let (arrived, cameras, clock): (Sender<Arrived>, _, _) = (arrived.clone(), cameras.clone(), clock.clone());
            thread::spawn(move || {
                let (mut reader, mut input) = (FrameReader::new(&cameras), BufReader::new(sender));
                loop {
                    match reader.read(&mut input, || clock.now_s()) {
                        Ok(image) => {
                            if arrived.send(image).is_err() {
                                return;
                            }
                        }
                        Err(fault) => {
                            if fault.kind() == ErrorKind::InvalidData {
                                eprintln!("a camera's sender is disconnected: {fault}");
                            }
                            return;
                        }
                    }
                }
            });
        }
    });
    Ok(images)
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::Pose;

    fn image(camera: u32, number: u32, capture_s: f64, depth_mm: u16) -> Vec<u8> {
        let words = |list: &[u32]| list.iter().flat_map(|it| it.to_le_bytes()).collect::<Vec<u8>>();
        let head =
            [b"CBD1".to_vec(), words(&[camera, number]), capture_s.to_le_bytes().to_vec(), words(&[4, 3, 1, 24])];
        [head.concat(), depth_mm.to_le_bytes().repeat(12)].concat()
    }

    #[test]
    fn every_status_is_told() {
        let cameras = [CameraModel::with_field_of_view(Pose::identity(), 4, 3, 1.0)];
        let mut reader = FrameReader::new(&cameras);
        let mut read = |bytes: Vec<u8>, now_s: f64| reader.read(&mut bytes.as_slice(), || now_s);
        let first = read(image(0, 0, 1.0, 1500), 1.01).unwrap();
        assert_eq!((first.status, first.frame.capture_s), (FrameStatus::Fresh, 1.0));
        assert!((first.frame.depth_m[7] - 1.5).abs() < 1e-6);
        for (number, capture_s, depth_mm, now_s, expected) in [
            (1, 1.01, 1501, 1.02, FrameStatus::Fresh),
            (4, 1.04, 1502, 1.05, FrameStatus::AfterLost(2)),
            (5, 1.05, 1502, 1.06, FrameStatus::Frozen),
            (6, 1.02, 1503, 1.07, FrameStatus::Swapped),
            (7, 1.08, 1504, 1.30, FrameStatus::Late),
        ] {
            assert_eq!(read(image(0, number, capture_s, depth_mm), now_s).unwrap().status, expected);
        }
        for (wrong, said) in [(image(1, 0, 1.0, 1), "camera: found 1"), (vec![0; 40], "CBD1")] {
            assert!(read(wrong, 1.0).unwrap_err().to_string().contains(said));
        }
        let mut wide = image(0, 8, 1.1, 1);
        wide[20] = 5;
        assert!(read(wide, 1.1).unwrap_err().to_string().contains("size of camera 0: found (5, 3, 24)"));
    }
}
