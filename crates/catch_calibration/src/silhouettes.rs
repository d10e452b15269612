//! Silhouettes of the arm: how many pixels show something on a line across each.
//!
//! A stereo camera shows more than there is: surfaces grow at their edges by a pixel or so, by more where the
//! silhouette is slanted to the line, and lose what is seen too steeply, also of the growth. So the number of
//! pixels is compared with the prediction, and growth and losses are estimated with everything else. A
//! surface point p on the silhouette that moves by u shifts it by f·(n·u)/(z·n_line), with the normal n,
//! which is perpendicular to the ray there.

use std::f64::consts::FRAC_PI_2;

use catch_body::ray_cast::SurfacePart;
use catch_bot::perception::arm_silhouette::{Search, crossings};
use catch_cell::{CameraModel, PixelWindow};
use nalgebra::{Point2, Vector2, Vector3};

use super::{
    AveragedImage, Config,
    averaged_image::StillImage,
    measurement::{Measurement, Quantity},
    rendering::Rendering,
};

/// Steps in which a silhouette is found between two pixels: to a 256th.
const BISECTIONS: usize = 8;
/// Silhouettes more slanted than this to their line are left to the lines across.
const STEEPEST: f64 = 1.0;
/// Angles of incidence between which a camera loses its pixels, in radians: 70° to 85°.
const GRAZING_RAD: [f64; 2] = [70.0_f64.to_radians(), 85.0_f64.to_radians()];

/// The silhouettes of an image that can be compared; without an image, those that could be.
pub fn measure(
    found: &mut Vec<Measurement>,
    rendering: &Rendering<'_>,
    camera: &CameraModel,
    image: Option<(&AveragedImage, &StillImage)>,
    config: &Config,
) {
    let reach = config.silhouette_px;
    let PixelWindow { left, top, width, height } = rendering.window;
    let in_image = |uv: &Point2<f64>| uv + Vector2::new(f64::from(left), f64::from(top));
    let search = Search { reach_px: reach, bisections: BISECTIONS, steepest: STEEPEST };
    let shows = |pixel| rendering.at(pixel).is_some();
    let is_there = |uv: &Point2<f64>| rendering.hit_at(&in_image(uv)).is_some();
    for it in crossings([width as usize, height as usize], &search, shows, is_there) {
        let hit = rendering.hit_at(&in_image(&it.point(it.inside_px)));
        let Some(hit) = hit.filter(|hit| hit.part != SurfacePart::Obstacle) else { continue };
        let ray_C = camera.back_project(&in_image(&it.point(it.at_px)), 1.0).coords;
        // Outward along the line, and the third component such that it is perpendicular to the ray.
        let outward = it.gradient() * if it.begins { -1.0 } else { 1.0 };
        let across_C = Vector3::new(outward.x, outward.y, -outward.x * ray_C.x - outward.y * ray_C.y);
        let (shows, predicted, weight) = match image {
            None => {
                // To the end of the line's window.
                let end = if it.begins { it.last + 1 + reach } else { it.last + 1 - reach };
                let between = (end as f64 - it.at_px).abs();
                (between, between, 1.0)
            }
            // A pixel shows what its centre's ray meets: half of the line's pixels are predicted to show the
            // arm.
            Some((image, still)) => {
                let shown = (it.last + 1 - reach..it.last + 1 + reach).map(|along| {
                    let [column, row] = it.pixel(along);
                    let pixel = [column + left as usize, row + top as usize];
                    image.shown_fraction(pixel, still, rendering.at([column, row]).unwrap_or(&hit).inverse_m)
                });
                (shown.sum(), reach as f64, image.count as f64)
            }
        };
        let grazing = |i: usize| {
            let inner = if it.begins { it.last + 1 + i } else { it.last - i };
            rendering.at(it.pixel(inner)).map_or(0.0, |it| missing_fraction(it.cosine))
        };
        found.push(Measurement {
            quantity: Quantity::ShownPixels {
                slope: it.slope.abs(),
                grazing_px: (0..reach).map(grazing).sum(),
                grazing_edge: grazing(0),
                along_row: it.along_row,
            },
            found: shows,
            predicted,
            gradient_C: across_C * (camera.focal_px * hit.inverse_m),
            p_C: ray_C / hit.inverse_m,
            normal_C: across_C.normalize(),
            part: hit.part,
            weight,
            place: [it.line as i32, it.last as i32],
        });
    }
}

/// Fraction of the pixels that a camera loses where the cosine of the incidence is this.
fn missing_fraction(cosine: f64) -> f64 {
    let [from, to] = GRAZING_RAD;
    let incidence = libm::acos(cosine.clamp(-1.0, 1.0)).min(FRAC_PI_2);
    ((incidence - from) / (to - from)).clamp(0.0, 1.0)
}
