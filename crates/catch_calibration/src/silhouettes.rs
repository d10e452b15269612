//! Silhouettes of the arm: how many pixels show something on a line across each.
//!
//! A stereo camera shows more than there is: surfaces grow at their edges by a pixel or so, by more where the
//! silhouette is slanted to the line, and lose what is seen too steeply, also of the growth. So the number of
//! pixels is compared with the prediction, and growth and losses are estimated with everything else. A
//! surface point p on the silhouette that moves by u shifts it by f·(n·u)/(z·n_line), with the normal n,
//! which is perpendicular to the ray there.

use catch_body::ray_cast::SurfacePart;
use catch_cell::CameraModel;
use nalgebra::{Point2, Vector3};

use super::{
    AveragedImage, Config,
    averaged_image::StillImage,
    measurement::{Measurement, Quantity},
    rendering::{Hit, Rendering},
};

/// Steps in which a silhouette is found between two pixels: to a 256th.
const BISECTIONS: usize = 8;
/// Silhouettes more slanted than this to their line are left to the lines across.
const STEEPEST: f64 = 1.0;

/// Crossing of a line of pixels with the silhouette.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    line: i64,
    /// The last pixel before the silhouette.
    last: i64,
    /// True if the arm begins there, false if it ends.
    begins: bool,
    /// Position along the line, in pixels of the window.
    at_px: f64,
    slope: f64,
    grazing_px: f64,
    grazing_edge: f64,
    hit: Hit,
}

/// The silhouettes of an image that can be compared; without an image, those that could be.
pub fn measure(
    found: &mut Vec<Measurement>,
    rendering: &Rendering<'_>,
    camera: &CameraModel,
    image: Option<(&AveragedImage, &StillImage)>,
    config: &Config,
) {
    let reach = config.silhouette_px as i64;
    for along_row in [true, false] {
        let mut crossings = crossings(rendering, along_row, config);
        add_slopes(&mut crossings);
        for it in crossings.iter().filter(|it| it.slope.abs() <= STEEPEST && it.hit.part != SurfacePart::Obstacle) {
            let (left, top) = (f64::from(rendering.window.left), f64::from(rendering.window.top));
            let across = it.line as f64 + 0.5;
            let (u_px, v_px) =
                if along_row { (left + it.at_px, top + across) } else { (left + across, top + it.at_px) };
            let ray_C = camera.back_project(&Point2::new(u_px, v_px), 1.0).coords;
            // Outward along the line, and the third component such that it is perpendicular to the ray.
            let outward = if it.begins { -1.0 } else { 1.0 };
            let (nx, ny) = if along_row { (outward, -outward * it.slope) } else { (-outward * it.slope, outward) };
            let across_C = Vector3::new(nx, ny, -nx * ray_C.x - ny * ray_C.y);
            let (shows, predicted, weight) = match image {
                None => {
                    // To the end of the line's window.
                    let end = if it.begins { it.last + 1 + reach } else { it.last + 1 - reach };
                    let between = (end as f64 - it.at_px).abs();
                    (between, between, 1.0)
                }
                // A pixel shows what its centre's ray meets: half of the line's pixels are predicted to show
                // the arm.
                Some((image, still)) => {
                    let shown = (it.last + 1 - reach..it.last + 1 + reach).map(|along| {
                        let (column, row) = if along_row { (along, it.line) } else { (it.line, along) };
                        let in_image = |at: i64, first: u32| (at + i64::from(first)) as usize;
                        let pixel = [in_image(column, rendering.window.left), in_image(row, rendering.window.top)];
                        image.shown_fraction(pixel, still, rendering.at(column, row).unwrap_or(&it.hit).inverse_m)
                    });
                    (shown.sum(), reach as f64, image.count as f64)
                }
            };
            found.push(Measurement {
                quantity: Quantity::ShownPixels {
                    slope: it.slope.abs(),
                    grazing_px: it.grazing_px,
                    grazing_edge: it.grazing_edge,
                    along_row,
                },
                found: shows,
                predicted,
                gradient_C: across_C * (camera.focal_px * it.hit.inverse_m),
                p_C: ray_C / it.hit.inverse_m,
                normal_C: across_C.normalize(),
                part: it.hit.part,
                weight,
                place: [it.line as i32, it.last as i32],
            });
        }
    }
}

/// Clean crossings on all rows or on all columns: nothing on one side, the arm on the other.
fn crossings(rendering: &Rendering<'_>, along_row: bool, config: &Config) -> Vec<Crossing> {
    let (wide, high) = (i64::from(rendering.window.width), i64::from(rendering.window.height));
    let (lines, length) = if along_row { (high, wide) } else { (wide, high) };
    let reach = config.silhouette_px as i64;
    let mut crossings = Vec::new();
    for line in 0..lines {
        let hit = |k: i64| if along_row { rendering.at(k, line) } else { rendering.at(line, k) };
        for last in reach - 1..length - reach {
            let begins = hit(last + 1).is_some();
            if begins == hit(last).is_some() {
                continue;
            }
            let is_clean =
                (0..reach).all(|i| hit(last - i).is_some() != begins && hit(last + 1 + i).is_some() == begins);
            if !is_clean {
                continue;
            }
            let inner = |i: i64| if begins { last + 1 + i } else { last - i };
            let Some(mut edge) = hit(inner(0)).copied() else { continue };
            let (left, top) = (f64::from(rendering.window.left), f64::from(rendering.window.top));
            let across = line as f64 + 0.5;
            let (mut outside, mut inside) =
                if begins { (last as f64 + 0.5, last as f64 + 1.5) } else { (last as f64 + 1.5, last as f64 + 0.5) };
            for _ in 0..BISECTIONS {
                let middle = f64::midpoint(outside, inside);
                let met = if along_row {
                    rendering.hit_at(left + middle, top + across)
                } else {
                    rendering.hit_at(left + across, top + middle)
                };
                match met {
                    Some(hit) => (inside, edge) = (middle, hit),
                    None => outside = middle,
                }
            }
            let grazing = |i: i64| hit(inner(i)).map_or(0.0, |it| config.missing_fraction(it.cosine));
            let (grazing_px, grazing_edge) = ((0..reach).map(grazing).sum(), grazing(0));
            let at_px = f64::midpoint(outside, inside);
            crossings.push(Crossing {
                line,
                last,
                begins,
                at_px,
                slope: f64::NAN,
                grazing_px,
                grazing_edge,
                hit: edge,
            });
        }
    }
    crossings
}

/// Slopes from the crossings of the same silhouette on the lines before and after; NaN where there are none.
fn add_slopes(crossings: &mut [Crossing]) {
    for i in 0..crossings.len() {
        let Crossing { line, begins, at_px, .. } = crossings[i];
        let belongs = |it: &Crossing| it.begins == begins && (it.at_px - at_px).abs() < 1.5 * STEEPEST;
        let before = crossings[..i].iter().rev().take_while(|it| it.line + 1 >= line);
        let before = before.filter(|it| it.line + 1 == line).find(|it| belongs(it)).map(|it| it.at_px);
        let after = crossings[i..].iter().take_while(|it| it.line <= line + 1);
        let after = after.filter(|it| it.line == line + 1).find(|it| belongs(it)).map(|it| it.at_px);
        if let (Some(before), Some(after)) = (before, after) {
            crossings[i].slope = (after - before) / 2.0;
        }
    }
}
