//! The colours of the picture.

pub use crate::surfaces::paint::Colour;
use crate::surfaces::paint::{BALL, OBJECT, TIP, grey};

/// The index that stands for "as it was".
pub const TRANSPARENT: u8 = 0;
/// Colour of the true path.
pub const TRUE: Colour = [0.85, 0.28, 0.06];
/// Colour of the predicted path.
pub const PREDICTED: Colour = [0.11, 0.43, 0.82];
/// Colour of the close-up's frame.
pub const FRAME: Colour = [0.45, 0.47, 0.5];

const GREYS: usize = 56;
const SHADES: usize = 18;

/// A fixed palette: greys for everything but the object and the paths.
#[derive(Debug)]
pub struct Palette {
    colours: Vec<Colour>,
    /// The most similar colour for each of 64³ boxes.
    nearest: Vec<u8>,
}

/// Boxes per channel.
const BOXES: usize = 64;

impl Palette {
    /// The palette.
    pub fn new() -> Self {
        let mut colours = vec![[0.0; 3]];
        // Slightly cool greys, as the page has them.
        colours.extend((0..GREYS).map(|i| grey(0.12 + 0.88 * i as f64 / (GREYS - 1) as f64)));
        let toward = |colour: Colour, other: Colour, steps: usize| {
            (1..=steps).map(move |i| {
                let fraction = i as f64 / steps as f64;
                [0, 1, 2].map(|c| other[c] + (colour[c] - other[c]) * fraction)
            })
        };
        for (colour, shades) in [(OBJECT, SHADES), (BALL, SHADES), (TIP, SHADES / 2)] {
            colours.extend(toward(colour.map(|value| value * 1.05), colour.map(|value| value * 0.3), shades));
        }
        for colour in [TRUE, PREDICTED] {
            colours.extend(toward(colour, grey(0.9), 6));
        }
        // The format wants a power of two.
        colours.resize(128, [0.0; 3]);
        let middle = |i: usize| (i as f64 + 0.5) / BOXES as f64;
        let all = (0..BOXES.pow(3)).map(|i| [middle(i / BOXES / BOXES), middle(i / BOXES % BOXES), middle(i % BOXES)]);
        let nearest = all.map(|colour| nearest(&colours, &colour)).collect();
        Self { colours, nearest }
    }

    /// Returns the palette as the file has it.
    pub fn bytes(&self) -> Vec<u8> {
        self.colours.iter().flatten().map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8).collect()
    }

    /// The index of the most similar colour.
    pub fn nearest(&self, colour: &Colour) -> u8 {
        let [r, g, b] = colour.map(|value| ((value * BOXES as f64) as usize).min(BOXES - 1));
        self.nearest[(r * BOXES + g) * BOXES + b]
    }
}

fn nearest(colours: &[Colour], colour: &Colour) -> u8 {
    let distance = |other: &Colour| (0..3).map(|c| (other[c] - colour[c]).powi(2)).sum::<f64>();
    let candidates = colours.iter().enumerate().skip(usize::from(TRANSPARENT) + 1);
    let best = candidates.min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)));
    best.map_or(1, |(index, _)| index as u8)
}
