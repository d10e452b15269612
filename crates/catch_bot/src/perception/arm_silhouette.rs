//! The silhouette of the arm in an image: where rows and columns of pixels cross it.

use nalgebra::{Point2, Vector2};

/// Settings of the search for crossings.
#[derive(Debug, Clone, Copy)]
pub struct Search {
    /// Pixels to each side of a crossing, one at least: the arm on one side, nothing on the other.
    pub reach_px: usize,
    /// Steps in which a crossing is found between two pixels.
    pub bisections: usize,
    /// Silhouettes more slanted than this to their line are left to the lines across.
    pub steepest: f64,
}

/// Crossing of a row or a column of pixels with the silhouette.
#[derive(Debug, Clone, Copy)]
pub struct Crossing {
    /// True if the crossing is met along a row, false if along a column.
    pub along_row: bool,
    /// Number of that row or column.
    pub line: usize,
    /// The last pixel before the silhouette.
    pub last: usize,
    /// True if the arm begins there, false if it ends.
    pub begins: bool,
    /// Position of the silhouette along the line, in pixels.
    pub at_px: f64,
    /// The position nearest to it that was found to show the arm.
    pub inside_px: f64,
    /// Change of the silhouette's position from line to line.
    pub slope: f64,
}

impl Crossing {
    /// Column and row of a pixel of the line.
    pub fn pixel(&self, along: usize) -> [usize; 2] {
        if self.along_row { [along, self.line] } else { [self.line, along] }
    }

    /// Image coordinates of a position on the line.
    pub fn point(&self, along_px: f64) -> Point2<f64> {
        let across_px = self.line as f64 + 0.5;
        if self.along_row { Point2::new(along_px, across_px) } else { Point2::new(across_px, along_px) }
    }

    /// Motion of the crossing along its line when the image moves by a pixel to the right, and down.
    pub fn gradient(&self) -> Vector2<f64> {
        if self.along_row { Vector2::new(1.0, -self.slope) } else { Vector2::new(-self.slope, 1.0) }
    }

    /// Finds the position between the two pixels.
    fn locate(&mut self, bisections: usize, is_there: impl Fn(&Point2<f64>) -> bool) {
        let [before, after] = [self.last as f64 + 0.5, self.last as f64 + 1.5];
        let (mut outside, mut inside) = if self.begins { (before, after) } else { (after, before) };
        for _ in 0..bisections {
            let middle = f64::midpoint(outside, inside);
            if is_there(&self.point(middle)) { inside = middle } else { outside = middle }
        }
        (self.at_px, self.inside_px) = (f64::midpoint(outside, inside), inside);
    }
}

/// The silhouette in an image whose pixels, by column and row, show the arm or nothing; between pixels by
/// asking whether something `is_there`.
pub fn crossings(
    [width, height]: [usize; 2],
    search: &Search,
    shows: impl Fn([usize; 2]) -> bool,
    is_there: impl Fn(&Point2<f64>) -> bool,
) -> Vec<Crossing> {
    let Search { reach_px, bisections, steepest } = *search;
    let mut found = Vec::new();
    for along_row in [true, false] {
        let (lines, length) = if along_row { (height, width) } else { (width, height) };
        let first = found.len();
        for line in 0..lines {
            for last in reach_px - 1..length.saturating_sub(reach_px) {
                let [at_px, inside_px, slope] = [f64::NAN; 3];
                let mut it = Crossing { along_row, line, last, begins: false, at_px, inside_px, slope };
                it.begins = shows(it.pixel(last + 1));
                // A clean edge: nothing on one side, the arm on the other.
                let is_clean = (0..reach_px)
                    .all(|i| shows(it.pixel(last - i)) != it.begins && shows(it.pixel(last + 1 + i)) == it.begins);
                if is_clean {
                    it.locate(bisections, &is_there);
                    found.push(it);
                }
            }
        }
        add_slopes(&mut found[first..], steepest);
    }
    found.retain(|it| it.slope.abs() <= steepest);
    found
}

/// Slopes from the crossings of the same silhouette on the lines before and after; NaN where there are none.
fn add_slopes(crossings: &mut [Crossing], steepest: f64) {
    for i in 0..crossings.len() {
        let Crossing { line, begins, at_px, .. } = crossings[i];
        let belongs = |it: &Crossing| it.begins == begins && (it.at_px - at_px).abs() < 1.5 * steepest;
        let before = crossings[..i].iter().rev().take_while(|it| it.line + 1 >= line);
        let before = before.filter(|it| it.line + 1 == line).find(|it| belongs(it));
        let after = crossings[i..].iter().take_while(|it| it.line <= line + 1);
        let after = after.filter(|it| it.line == line + 1).find(|it| belongs(it));
        if let (Some(before), Some(after)) = (before, after) {
            crossings[i].slope = (after.at_px - before.at_px) / 2.0;
        }
    }
}
