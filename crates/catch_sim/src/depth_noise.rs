//! `[arena.depth]`: what real depth cameras make of the truth. Formulas and figures;
//! [`cameras`](crate::cameras) applies them.

use catch_body::{InputError, quantity};
use catch_cell::CameraModel;
use serde::{Deserialize, Serialize};

use crate::drawn::Drawn;

/// Errors of the depth images. None by default, as in the paper.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DepthConfig {
    /// The errors of a pixel's depth.
    pub model: DepthModel,
    /// Fraction of the images that never arrive, each camera and each time by itself. Users of D435 cameras
    /// report 5 to 10 %.
    pub lost_frame_fraction: quantity::fraction,
    /// Fraction of the images whose fate is that of the camera's image before them, so that images are lost
    /// in bursts of 1/((1 − this)·(1 − `lost_frame_fraction`)) on average.
    pub lost_frame_persistence: quantity::spread,
    /// Fraction of the object's surface, dark or specular, of which no camera measures any depth: a number,
    /// or `{ min, max }` from which every throw draws. It is in patches that are fixed to the object.
    pub hole_fraction: quantity::fraction<Drawn>,
    /// Depths are whole multiples of this, in metres: 1 mm for cameras that tell them as whole millimetres.
    /// Zero: any.
    pub step_m: quantity::error_m,
    /// Standard deviation, along each axis, of where a camera truly stands around where the brain believes it
    /// stands, in metres. Drawn once per scene and camera.
    pub calibration_sd_m: quantity::error_m,
    /// Standard deviation of the rotation of each camera from its calibrated orientation, about each of its
    /// axes, in radians.
    pub calibration_sd_rad: quantity::error_rad,
    /// Shift of everything in the images to the left and up, in pixels, in the scan of the object as well:
    /// half a pixel where corners of pixels are taken for their centres, as in the authors' code.
    pub pixel_shift_px: quantity::error_px,
}

impl DepthConfig {
    /// The camera that takes the images of one that is believed to be `camera`, as far as its principal point
    /// goes.
    pub fn shifted(&self, camera: &CameraModel) -> CameraModel {
        let principal_px = camera.principal_px.map(|centre| centre - self.pixel_shift_px);
        CameraModel { principal_px, ..camera.clone() }
    }
}

/// The errors of a pixel's depth: none, those of a file of `assets/depth_errors` by its name, or a table with
/// figures of one's own.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DepthModel {
    /// No errors.
    #[default]
    Perfect,
    /// Noise with the same standard deviation at every depth, each pixel by itself.
    Gaussian(GaussianNoise),
    /// Errors of a stereo camera.
    Stereo(StereoNoise),
}

/// A constant standard deviation.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GaussianNoise {
    /// Standard deviation of a depth in metres.
    pub sd_m: quantity::error_m,
}

/// The errors of a stereo camera.
///
/// It measures a disparity d = f·b/z in pixels, with the focal length f of the camera and the baseline b. An
/// error of the disparity with the standard deviation s becomes one of the depth with σ(z) = z²·s/(f·b) (A.
/// Grunnet-Jepsen, J. N. Sweetser & J. Woodfill, Tuning depth cameras for best performance, Intel).
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StereoNoise {
    /// Distance between the two eyes in metres.
    pub baseline_m: quantity::size_m,
    /// Standard deviation of the disparity in pixels.
    pub subpixel_px: quantity::error_px,
    /// Fraction of the disparity's variance that all pixels of one image have in common; the rest each pixel
    /// has by itself.
    pub common_fraction: quantity::fraction,
    /// Fraction of the pixels that are missing on surfaces which face the camera.
    pub dropout_fraction: quantity::fraction,
    /// Angles of incidence, from the surface's normal in radians, between which the fraction of missing
    /// pixels rises linearly to all. None: it does not.
    pub grazing_rad: quantity::incidence_rad<Option<[f64; 2]>>,
    /// Number of pixels beside a depth edge that are affected by it: half of the window that is matched.
    pub edge_px: quantity::edge_px<u32>,
    /// Fraction of the affected pixels behind the edge that shows the nearer surface, which so grows by some
    /// pixels.
    pub bleed_fraction: quantity::fraction,
    /// Fraction of the affected pixels on both sides that shows no surface, but a disparity evenly anywhere
    /// between the two: flying pixels.
    pub flying_fraction: quantity::fraction,
    /// Depths that can be measured, from and to, in metres. None: all.
    pub range_m: quantity::distance_m<Option<[f64; 2]>>,
}

impl Default for StereoNoise {
    /// Bare stereo with a baseline of 95 mm: 114 mm at 7 m from a camera with a focal length of 362 pixels.
    fn default() -> Self {
        Self {
            baseline_m: 0.095,
            subpixel_px: 0.08,
            common_fraction: 0.0,
            dropout_fraction: 0.0,
            grazing_rad: None,
            edge_px: 0,
            bleed_fraction: 0.0,
            flying_fraction: 0.0,
            range_m: None,
        }
    }
}

/// Neighbouring disparities that differ by more than this, in pixels, are a depth edge: less is not told from
/// noise.
pub(crate) const EDGE_JUMP_PX: f64 = 0.5;

impl StereoNoise {
    /// Distance around a pixel in which other pixels affect its measurement, in pixels.
    pub(crate) fn edge_reach_px(&self) -> u32 {
        if self.bleed_fraction + self.flying_fraction > 0.0 { self.edge_px } else { 0 }
    }

    /// Standard deviation of 1/z, in 1/m, of a camera with this focal length: s/(f·b).
    pub fn inverse_depth_sd_per_m(&self, focal_px: f64) -> f64 {
        self.subpixel_px / (focal_px * self.baseline_m)
    }
}

impl DepthModel {
    /// The figures of a stereo camera.
    pub fn stereo(&self) -> Option<&StereoNoise> {
        if let Self::Stereo(noise) = self { Some(noise) } else { None }
    }
}

impl DepthConfig {
    /// Checks that the values fit together; `file` and `table` name the place in errors.
    ///
    /// # Errors
    /// Ranges whose ends are swapped, fractions whose sum is above one.
    pub fn check(&self, file: &str, table: &str) -> Result<(), InputError> {
        let DepthModel::Stereo(noise) = &self.model else { return Ok(()) };
        let field = |name: &str| format!("{table}.model.stereo.{name}");
        let rising = |name: &str, values: Option<[f64; 2]>| match values {
            Some([from, to]) if from >= to => {
                Err(InputError::new(file, field(name), format!("[{from}, {to}]"), "two rising numbers"))
            }
            _ => Ok(()),
        };
        let affected = noise.bleed_fraction + noise.flying_fraction;
        InputError::first_of([
            rising("grazing_rad", noise.grazing_rad),
            rising("range_m", noise.range_m),
            quantity::FRACTION.check(file, field("bleed_fraction + flying_fraction"), affected).map(drop),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_are_called_by_name_or_described() {
        let parse = |text: &str| toml::from_str::<DepthConfig>(text).map(|config| config.model);
        assert_eq!(parse("").unwrap(), DepthModel::Perfect);
        assert_eq!(parse("model = \"perfect\"").unwrap(), DepthModel::Perfect);
        assert_eq!(
            parse("model = { gaussian = { sd_m = 0.002 } }").unwrap(),
            DepthModel::Gaussian(GaussianNoise { sd_m: 0.002 })
        );
        let stereo = parse("[model.stereo]\nbaseline_m = 0.05").unwrap();
        assert_eq!(*stereo.stereo().unwrap(), StereoNoise { baseline_m: 0.05, ..StereoNoise::default() });
        for text in ["model = \"stereo8\"", "model = { stereo = { base_m = 0.05 } }", "model = { gaussian = {} }"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }

    /// σ(z) = z²·σ(1/z).
    #[test]
    fn the_usual_stereo_camera_errs_by_114_mm_at_7_m() {
        let sd_m = 7.0 * 7.0 * StereoNoise::default().inverse_depth_sd_per_m(362.0);
        assert!((sd_m - 0.114).abs() < 1e-4, "{sd_m}");
    }

    #[derive(Deserialize)]
    struct File {
        arena: Arena,
    }

    #[derive(Deserialize)]
    struct Arena {
        depth: DepthConfig,
    }

    #[test]
    fn values_out_of_range_are_named() {
        for (text, field) in [
            ("lost_frame_fraction = 1.5", "arena.depth.lost_frame_fraction"),
            ("lost_frame_persistence = 2", "arena.depth.lost_frame_persistence"),
            ("hole_fraction = { min = 0.3, max = 0.2 }", "arena.depth.hole_fraction"),
            ("hole_fraction = 1.1", "arena.depth.hole_fraction"),
            ("step_m = -0.001", "arena.depth.step_m"),
            ("calibration_sd_m = -0.1", "arena.depth.calibration_sd_m"),
            ("calibration_sd_rad = nan", "arena.depth.calibration_sd_rad"),
            ("model = { gaussian = { sd_m = -1.0 } }", "arena.depth.model.gaussian.sd_m"),
            ("model = { stereo = { baseline_m = 0.0 } }", "arena.depth.model.stereo.baseline_m"),
            (
                "model = { stereo = { bleed_fraction = 0.7, flying_fraction = 0.7 } }",
                "bleed_fraction + flying_fraction",
            ),
            ("model = { stereo = { range_m = [3.0, 1.0] } }", "arena.depth.model.stereo.range_m"),
            ("model = { stereo = { edge_px = 100 } }", "arena.depth.model.stereo.edge_px"),
        ] {
            let text = text.split_once('=').map(|(name, value)| format!("arena.depth.{name}={value}")).unwrap();
            let config = InputError::parse_toml::<File>("s.toml", &text).map(|file| file.arena.depth);
            let fault = config.and_then(|config| config.check("s.toml", "arena.depth")).unwrap_err().to_string();
            assert!(fault.contains(field), "{fault}");
        }
        assert_eq!(DepthConfig::default().check("s.toml", "arena.depth"), Ok(()));
    }
}
