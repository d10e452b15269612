//! Prior knowledge of a cell's owner: of the object, from a scale, a scan and tables; of a camera, from its
//! data sheet.
//!
//! Nothing here is true by construction. A simulated arena never reads it, and a wrong value costs catches as
//! it would in a real cell.

use catch_body::{InputError, quantity};
use serde::{Deserialize, Serialize, de::IgnoredAny};

use crate::ReferenceScan;

/// An object as its owner knows it: a scan of its shape, and figures with their standard deviations.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KnownObject {
    /// Depth images from all around.
    pub scan: ReferenceScan,
    /// Everything else.
    pub figures: ObjectFigures,
}

/// Figures of an object that can be weighed, looked up or guessed: the table `[known]` of its file.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ObjectFigures {
    /// Expected drag constant k of a = −k·|v|·v, in 1/m.
    pub drag_per_m: quantity::drag_per_m,
    /// Standard deviation of the drag constant.
    pub drag_sd_per_m: quantity::drag_per_m,
    /// Mass in kg by a scale, if somebody has weighed it.
    pub mass_kg: quantity::thrown_mass_kg<Option<f64>>,
    /// Expected coefficient of restitution against the gripper, 0 to 1, if anything is known of it.
    pub restitution: quantity::fraction<Option<f64>>,
    /// Standard deviation in metres of each coordinate of its centre of mass about that of uniform density; 2
    /// mm if nobody says. It is estimated in flight, as far as the spin shows it.
    #[serde(default = "typical_com_sd_m")]
    pub com_sd_m: quantity::error_m,
}

/// Standard deviation for an object whose density nobody has looked into: a claim of zero costs catches of
/// all objects that are not uniform.
fn typical_com_sd_m() -> f64 {
    0.002
}

impl Default for ObjectFigures {
    /// Drag constant of a typical object: those of things that people throw are from 0.01 to 0.1 1/m.
    fn default() -> Self {
        Self { drag_per_m: 0.04, drag_sd_per_m: 0.02, mass_kg: None, restitution: None, com_sd_m: typical_com_sd_m() }
    }
}

/// An object's file, of which the table `known` is read; the others belong to whoever simulates the object.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectFile {
    #[serde(alias = "prior")]
    known: ObjectFigures,
    #[serde(rename = "name")]
    _name: Option<IgnoredAny>,
    #[serde(rename = "truth")]
    _truth: Option<IgnoredAny>,
    #[serde(rename = "published")]
    _published: Option<IgnoredAny>,
}

impl ObjectFigures {
    /// Reads the table `[known]` of an object's TOML file, whether it has a file of its own or stands beside
    /// `[truth]`; `file` names it in errors.
    ///
    /// # Errors
    /// A field that is missing, misspelt or out of range.
    pub fn from_toml(file: &str, text: &str) -> Result<Self, InputError> {
        InputError::parse_toml::<ObjectFile>(file, text).map(|it| it.known)
    }
}

/// Errors of a depth camera according to its data sheet, and as its owner has observed them.
///
/// The standard deviation of a depth z is c + (q + s/(f·b))·z², with the focal length f in pixels.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DataSheet {
    /// The part c that does not depend on the distance, in metres.
    pub constant_m: quantity::error_m,
    /// The part q that grows with the square of the distance whatever the focal length, in 1/m.
    pub quadratic_per_m: quantity::inverse_depth_per_m,
    /// The standard deviation s of the disparity of a stereo camera, in pixels.
    pub subpixel_px: quantity::error_px,
    /// The distance b between its two eyes, in metres.
    pub baseline_m: quantity::size_m,
    /// Fraction of the variance that all pixels of one image have in common.
    pub common_fraction: quantity::fraction,
    /// True if pixels may be missing where there is something.
    pub dropout: bool,
    /// Number of pixels beside a depth edge that may show something else than what is there.
    pub edge_px: quantity::edge_px<u32>,
    /// Depths that can be measured, from and to, in metres. None: all.
    pub range_m: quantity::distance_m<Option<[f64; 2]>>,
}

impl Default for DataSheet {
    /// A camera without errors.
    fn default() -> Self {
        Self {
            constant_m: 0.0,
            quadratic_per_m: 0.0,
            subpixel_px: 0.0,
            baseline_m: 0.05,
            common_fraction: 0.0,
            dropout: false,
            edge_px: 0,
            range_m: None,
        }
    }
}

impl DataSheet {
    /// Reads a camera's TOML file; `file` names it in errors.
    ///
    /// # Errors
    /// A field that is misspelt or out of range.
    pub fn from_toml(file: &str, text: &str) -> Result<Self, InputError> {
        let sheet: Self = InputError::parse_toml(file, text)?;
        match sheet.range_m {
            Some([from, to]) if from >= to => {
                Err(InputError::new(file, "range_m", format!("[{from}, {to}]"), "two rising numbers"))
            }
            _ => Ok(sheet),
        }
    }

    /// The standard deviation of a depth over its square, in 1/m, for a camera with this focal length in
    /// pixels.
    pub fn quadratic_per_m(&self, focal_px: f64) -> f64 {
        self.quadratic_per_m + self.subpixel_px / (focal_px * self.baseline_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_read_from_a_file_of_their_own_and_from_beside_the_truth() {
        let known = "[known]\ndrag_per_m = 0.02\ndrag_sd_per_m = 0.004\nmass_kg = 0.058\n";
        let alone = ObjectFigures::from_toml("known.toml", known).unwrap();
        assert_eq!((alone.drag_per_m, alone.mass_kg, alone.restitution), (0.02, Some(0.058), None));
        let beside = format!("name = \"ball\"\n[truth]\nmass_kg = 1.0\n{known}");
        assert_eq!(ObjectFigures::from_toml("ball.toml", &beside).unwrap(), alone);
        for (text, field) in [
            ("[known]\ndrag_per_m = 0.02\n", "drag_sd_per_m"),
            ("[known]\ndrag_per_m = 0.02\ndrag_sd_per_m = 0.0\nrestitution = 1.5\n", "known.restitution"),
            ("[knwon]\n", "knwon"),
        ] {
            let fault = ObjectFigures::from_toml("known.toml", text).unwrap_err().to_string();
            assert!(fault.contains(field), "{fault}");
        }
    }

    #[test]
    fn a_data_sheet_gives_the_error_of_a_depth() {
        let sheet = DataSheet::from_toml("c.toml", "subpixel_px = 0.08\nbaseline_m = 0.095\n").unwrap();
        // 114 mm at 7 m from a camera with 362 pixels.
        assert!((sheet.quadratic_per_m(362.0) * 49.0 - 0.114).abs() < 1e-4);
        for (text, field) in [
            ("subpixel = 0.08", "subpixel"),
            ("baseline_m = 0.0", "baseline_m"),
            ("common_fraction = 1.5", "common_fraction"),
            ("range_m = [3.0, 1.0]", "range_m"),
        ] {
            let fault = DataSheet::from_toml("c.toml", text).unwrap_err().to_string();
            assert!(fault.contains("c.toml") && fault.contains(field), "{fault}");
        }
    }
}
