//! A throw as a small moving picture, for pages that show nothing else.
//!
//! The arena's ray caster draws it: arm, gripper and object shaded, their shadows on the floor, the object's
//! true path behind it and the predicted one before it. Around the contact time passes slower, and hand and
//! object are seen from near, with arm and flight in a corner. Without ground truth the arm is as it was
//! sensed, and object and true path are absent. All images share one palette, and each holds only the
//! rectangle that changed.

mod palette;

use std::borrow::Cow;

use catch_cell::CameraModel;
use gif::{DisposalMethod, Encoder, EncodingError, Frame, Repeat};
use nalgebra::Point3;

use crate::{
    playback::{MotionSample, Playback},
    shading::{Line, Shader},
    viewpoint::{CatchScene, Viewpoint, between},
};
use palette::{Colour, FRAME, Palette, TRANSPARENT};

/// Size in pixels.
const WIDTH: u16 = 560;
/// Size in pixels.
const HEIGHT: u16 = 350;
/// Width and height in pixels of the overview beside a close-up, its frame included.
const INSET: [u16; 2] = [200, 125];
/// The file is made no larger than this, in bytes: longer steps instead.
const MOST_BYTES: usize = 400_000;
/// Duration of an image, in hundredths of a second.
const DELAY_CS: u16 = 4;
/// Speed of the picture over that of the throw, away from the contact and around it.
const SPEEDS: [f64; 2] = [0.3, 0.06];
/// Time around the contact in which the picture is slow, and time before it in which it slows down.
const SLOW_S: [f64; 2] = [0.03, 0.12];
/// Duration of the last image, in hundredths of a second.
const LAST_DELAY_CS: u16 = 150;
/// Longest part of a recording before the end of the flight that is shown, in seconds.
const LONGEST_S: f64 = 4.0;
/// Duration of the picture after the contact, in seconds.
const AFTER_CONTACT_S: f64 = 0.2;
/// Time before the contact from which the close-up is shown, in seconds.
const CLOSE_UP_S: f64 = 0.15;
/// Pieces of a path.
const PIECE_S: f64 = 0.015;

/// The picture of a throw, as a GIF file; empty for a recording without motion.
///
/// # Errors
/// If it cannot be encoded, which would be a bug.
pub fn gif(playback: &Playback) -> Result<Vec<u8>, EncodingError> {
    let Some(scene) = CatchScene::new(playback) else { return Ok(Vec::new()) };
    let object = playback.ground_truth().map(|it| it.surface.mesh());
    let view = scene.scene();
    let picture = Picture {
        playback,
        shader: Shader::new(&playback.robot, &playback.gripper, object.as_ref()),
        camera: scene.framed(&view, [WIDTH, HEIGHT]),
        overview: scene.framed(&view, INSET),
        close_up: scene.close_up(),
        palette: Palette::new(),
    };
    let mut stretch = 1.0;
    loop {
        let file = picture.encode(stretch)?;
        if file.len() <= MOST_BYTES || stretch > 8.0 {
            return Ok(file);
        }
        stretch *= 1.05 * file.len() as f64 / MOST_BYTES as f64;
    }
}

/// All that the images share.
struct Picture<'a> {
    playback: &'a Playback,
    shader: Shader,
    camera: CameraModel,
    overview: CameraModel,
    close_up: Viewpoint,
    palette: Palette,
}

impl Picture<'_> {
    /// The file with images `stretch` times as far apart as they should be.
    fn encode(&self, stretch: f64) -> Result<Vec<u8>, EncodingError> {
        let times_s = self.times_s(stretch);
        let mut file = Vec::new();
        let mut encoder = Encoder::new(&mut file, WIDTH, HEIGHT, &self.palette.bytes())?;
        encoder.set_repeat(Repeat::Infinite)?;
        let mut before: Option<Vec<u8>> = None;
        for (image, time_s) in times_s.iter().enumerate() {
            let Some(sample) = self.playback.motion_at(*time_s) else { continue };
            let pixels = self.image(&sample);
            let mut frame = changes(before.as_deref(), &pixels);
            let delay_cs = (f64::from(DELAY_CS) * stretch).round() as u16;
            frame.delay = if image + 1 == times_s.len() { LAST_DELAY_CS } else { delay_cs };
            encoder.write_frame(&frame)?;
            before = Some(pixels);
        }
        drop(encoder);
        Ok(file)
    }

    /// Times of the images: closer to each other around the contact.
    fn times_s(&self, stretch: f64) -> Vec<f64> {
        let contact_s = self.playback.flight_end_s();
        let until_s = (contact_s + AFTER_CONTACT_S).min(self.playback.end_s());
        let mut time_s = self.playback.start_s().max(contact_s - LONGEST_S);
        let mut times_s = Vec::new();
        while time_s < until_s {
            times_s.push(time_s);
            let away = (((time_s - contact_s).abs() - SLOW_S[0]) / SLOW_S[1]).clamp(0.0, 1.0);
            let speed = SPEEDS[1] + (SPEEDS[0] - SPEEDS[1]) * away;
            time_s += f64::from(DELAY_CS) / 100.0 * speed * stretch;
        }
        times_s.push(until_s);
        times_s
    }

    /// An image as numbers of the palette's colours: arm and flight, and around the catch hand and object,
    /// with arm and flight in a corner.
    fn image(&self, sample: &MotionSample) -> Vec<u8> {
        let lines = lines(self.playback, sample);
        let colours = if sample.time_s < self.playback.flight_end_s() - CLOSE_UP_S {
            self.shader.image(&self.camera, sample, &lines)
        } else {
            let (target, radius_m) = between(self.playback, sample, self.close_up.radius_m);
            let near = self.close_up.around(&target, radius_m, [WIDTH, HEIGHT].map(u32::from));
            let mut colours = self.shader.image(&near, sample, &lines);
            inset(&mut colours, &self.shader.image(&self.overview, sample, &lines));
            colours
        };
        colours.iter().map(|colour| self.palette.nearest(colour)).collect()
    }
}

/// Puts the overview into the lower left corner.
fn inset(colours: &mut [Colour], overview: &[Colour]) {
    let (columns, rows) = (usize::from(INSET[0]), usize::from(INSET[1]));
    for (row, pixels) in overview.chunks(columns).enumerate() {
        let start = (usize::from(HEIGHT) - rows + row) * usize::from(WIDTH);
        colours[start..start + columns].copy_from_slice(pixels);
        colours[start + columns - 1] = FRAME;
        if row == 0 {
            colours[start..start + columns].fill(FRAME);
        }
    }
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
        let path = path(now_s, plan.catch_s, |at_s| Some(flight.pose_at(at_s) * com_O));
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
