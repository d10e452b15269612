//! A throw as a small moving picture, for pages that show nothing else.
//!
//! The arena's ray caster draws it: arm, gripper and object shaded, their shadows on the floor, the object's
//! true path behind it and the predicted one before it. Without ground truth the arm is as it was sensed, and
//! object and true path are absent. All images share one palette, and each holds only the rectangle that
//! changed.

mod camera;
mod palette;
mod shading;

use std::borrow::Cow;

use gif::{DisposalMethod, Encoder, EncodingError, Frame, Repeat};
use nalgebra::Point3;

use crate::playback::{MotionSample, Playback};
use palette::{Palette, TRANSPARENT};
use shading::{Line, Shader};

/// Size in pixels.
const WIDTH: u16 = 480;
/// Size in pixels.
const HEIGHT: u16 = 300;
/// The file is made no larger than this, in bytes: longer steps instead.
const MOST_BYTES: usize = 400_000;
/// Time between two images, in seconds of the throw, if the file does not get too large.
const STEP_S: f64 = 0.0125;
/// Duration of an image, in hundredths of a second: 3.2 times slower than it happened.
const DELAY_CS: u16 = 4;
/// Duration of the last image, in hundredths of a second.
const LAST_DELAY_CS: u16 = 150;
/// Longest part of a recording before the end of the flight that is shown, in seconds.
const LONGEST_S: f64 = 4.0;
/// Duration of the picture after the contact, in seconds.
const AFTER_CONTACT_S: f64 = 0.3;
/// Duration of a predicted path after the planned catch, in seconds.
const BEYOND_CATCH_S: f64 = 0.1;
/// Pieces of a path.
const PIECE_S: f64 = 0.015;

/// The picture of a throw, as a GIF file.
///
/// # Errors
/// If it cannot be encoded, which would be a bug.
pub fn gif(playback: &Playback) -> Result<Vec<u8>, EncodingError> {
    let shader = Shader::new(playback, WIDTH, HEIGHT);
    let mut step_s = STEP_S;
    loop {
        let file = encode(playback, &shader, step_s)?;
        if file.len() <= MOST_BYTES || step_s > 0.1 {
            return Ok(file);
        }
        step_s *= 1.05 * file.len() as f64 / MOST_BYTES as f64;
    }
}

fn encode(playback: &Playback, shader: &Shader, step_s: f64) -> Result<Vec<u8>, EncodingError> {
    let palette = Palette::new();
    let until_s = (playback.flight_end_s() + AFTER_CONTACT_S).min(playback.end_s());
    let from_s = playback.start_s().max(playback.flight_end_s() - LONGEST_S);
    let images = ((until_s - from_s) / step_s).floor() as usize + 1;
    let delay_cs = (f64::from(DELAY_CS) * step_s / STEP_S).round() as u16;
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, WIDTH, HEIGHT, &palette.bytes())?;
    encoder.set_repeat(Repeat::Infinite)?;
    let mut before: Option<Vec<u8>> = None;
    for image in 0..images {
        let Some(sample) = playback.motion_at(from_s + image as f64 * step_s) else { continue };
        let colours = shader.image(&sample, &lines(playback, &sample));
        let pixels: Vec<u8> = colours.iter().map(|colour| palette.nearest(colour)).collect();
        let mut frame = changes(before.as_deref(), &pixels);
        frame.delay = if image + 1 == images { LAST_DELAY_CS } else { delay_cs };
        encoder.write_frame(&frame)?;
        before = Some(pixels);
    }
    drop(encoder);
    Ok(file)
}

/// The smallest rectangle that holds all changes; within it, what did not change is left as it is.
fn changes(before: Option<&[u8]>, pixels: &[u8]) -> Frame<'static> {
    let width = usize::from(WIDTH);
    let Some(before) = before else {
        return Frame { width: WIDTH, height: HEIGHT, buffer: Cow::Owned(pixels.to_vec()), ..Frame::default() };
    };
    let changed = |&at: &usize| before[at] != pixels[at];
    let all = || (0..pixels.len()).filter(changed);
    let columns = || all().map(|at| at % width);
    let (left, right) = (columns().min().unwrap_or(0), columns().max().unwrap_or(0));
    let (top, bottom) = (all().next().unwrap_or(0) / width, all().next_back().unwrap_or(0) / width);
    let inside = (top..=bottom).flat_map(|row| (left..=right).map(move |column| row * width + column));
    let buffer = inside.map(|at| if changed(&at) { pixels[at] } else { TRANSPARENT }).collect();
    Frame {
        left: left as u16,
        top: top as u16,
        width: (right - left + 1) as u16,
        height: (bottom - top + 1) as u16,
        transparent: Some(TRANSPARENT),
        dispose: DisposalMethod::Keep,
        buffer: Cow::Owned(buffer),
        ..Frame::default()
    }
}

/// The true path up to a time, and the path that was predicted then.
fn lines(playback: &Playback, sample: &MotionSample) -> Vec<Line> {
    let now_s = sample.time_s;
    let mut lines = Vec::new();
    let tick = playback.ticks.iter().rev().find(|tick| tick.observation.time_s <= now_s);
    let report = tick.map(|tick| &tick.report);
    if let Some((flight, plan)) = report.and_then(|it| it.flight.as_ref().zip(it.plan.as_ref())) {
        let com_O = playback.com_O();
        let path = path(now_s, plan.catch_s + BEYOND_CATCH_S, |at_s| Some(flight.pose_at(at_s) * com_O));
        lines.push(Line { path, colour: palette::PREDICTED, width_px: 2.0 });
    }
    if playback.ground_truth().is_none() {
        return lines;
    }
    let until_s = now_s.min(playback.flight_end_s());
    let path = path(0.0, until_s, |at_s| Some(playback.truth_at(at_s)?.X_WO.translation.vector.into()));
    lines.push(Line { path, colour: palette::TRUE, width_px: 2.4 });
    lines
}

fn path(from_s: f64, until_s: f64, at: impl Fn(f64) -> Option<Point3<f64>>) -> Vec<Point3<f64>> {
    let pieces = ((until_s - from_s) / PIECE_S).ceil().max(0.0) as usize;
    (0..=pieces).filter_map(|i| at((from_s + i as f64 * PIECE_S).min(until_s))).collect()
}
