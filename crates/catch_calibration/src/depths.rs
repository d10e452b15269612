//! Inverse depths of the arm's surface, compared along the ray of each pixel.
//!
//! A surface that moves by u meets the ray of direction d = (x, y, 1) at another depth: δz = n·u/(n·d), with
//! its normal n at the point z·d; so δ(1/z) = −n·u/(z²·n·d). Pixels are chosen by the prediction and never by
//! what they show: those that face the camera and are not beside a depth edge, where cameras show what is not
//! there.

use catch_body::ray_cast::SurfacePart;

use super::{
    AveragedImage, Config,
    measurement::{Measurement, Quantity},
    rendering::{Hit, Rendering},
};
use catch_cell::{CameraModel, camera::among_neighbours};
use nalgebra::Point2;

/// Surfaces seen more steeply than this, from their normal in radians, have no depths to compare: 60°.
const MAX_INCIDENCE_RAD: f64 = 60.0_f64.to_radians();
/// Neighbours whose 1/z differ by so many standard deviations are at a depth edge.
const JUMP_SD: f64 = 3.0;

/// The depths of an image that can be compared; without an image, those that could be.
pub fn measure(
    found: &mut Vec<Measurement>,
    rendering: &Rendering<'_>,
    camera: &CameraModel,
    image: Option<&AveragedImage>,
    config: &Config,
) {
    let least_cosine = libm::cos(MAX_INCIDENCE_RAD);
    let beside_edge = beside_edges(rendering, JUMP_SD * config.inverse_depth_sd_per_m, config.edge_px);
    let window = rendering.window;
    let wide = window.width as usize;
    for (i, hit) in rendering.hits.iter().enumerate() {
        let is_usable = |it: &&Hit| it.cosine > least_cosine && it.part != SurfacePart::Obstacle;
        let Some(hit) = hit.as_ref().filter(is_usable).filter(|_| !beside_edge[i]) else { continue };
        let (column, row) = (window.left as usize + i % wide, window.top as usize + i / wide);
        let ray_C = camera.back_project(&Point2::new(column as f64 + 0.5, row as f64 + 0.5), 1.0).coords;
        let facing = hit.normal_C.dot(&ray_C);
        let (shows, weight) = match image {
            None => (hit.inverse_m, 1.0),
            Some(image) => {
                let (inverse_m, shown) = image.at(column, row);
                if shown == 0 {
                    continue;
                }
                (f64::from(inverse_m), f64::from(shown))
            }
        };
        found.push(Measurement {
            quantity: Quantity::InverseDepth,
            found: shows,
            predicted: hit.inverse_m,
            gradient_C: -hit.normal_C * (hit.inverse_m * hit.inverse_m / facing),
            p_C: ray_C / hit.inverse_m,
            normal_C: hit.normal_C,
            part: hit.part,
            weight,
            place: [row as i32, column as i32],
        });
    }
}

/// Mask of the pixels of a rendering that lie within `reach` rows and columns of a depth edge.
fn beside_edges(rendering: &Rendering<'_>, jump_per_m: f64, reach: usize) -> Vec<bool> {
    let (wide, high) = (rendering.window.width as usize, rendering.window.height as usize);
    let inverse_m = |i: usize| rendering.hits[i].map_or(0.0, |it| it.inverse_m);
    let mut edge = vec![false; wide * high];
    for row in 0..high {
        for column in 0..wide {
            let i = row * wide + column;
            for (exists, next) in [(column + 1 < wide, i + 1), (row + 1 < high, i + wide)] {
                if exists && (inverse_m(i) - inverse_m(next)).abs() > jump_per_m {
                    (edge[i], edge[next]) = (true, true);
                }
            }
        }
    }
    among_neighbours(&edge, wide, reach, |one, other| one | other)
}
