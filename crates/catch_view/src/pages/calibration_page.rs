//! A calibration as one page: what the cameras show beside the arm as predicted.

use catch_calibration::overlay::Overlay;
use serde_json::{Value, json};

use super::{
    document, fill,
    packed::{self, Packed},
};

const PAGE: &str = include_str!("calibration_page/page.html");
const SCRIPT: &str = include_str!("calibration_page/calibration.js");

/// A camera on the page.
#[derive(Debug)]
pub struct CameraSection {
    /// Result of the camera's calibration, in a line.
    pub summary: String,
    /// Some of its images.
    pub overlays: Vec<Overlay>,
}

/// The page of a calibration.
pub fn page(title: &str, cameras: &[CameraSection]) -> String {
    let image = |it: &Overlay| {
        // Runs of pixels: 1 for something shown plus 2 for the arm predicted, and how many.
        let runs = Packed::indices(runs(it).into_iter().flatten(), 2);
        json!({ "width": it.width_px, "height": it.shown.len() / it.width_px.max(1), "runs": runs })
    };
    let images = |it: &CameraSection| it.overlays.iter().map(image).collect::<Value>();
    let data: Value = cameras.iter().map(|it| json!({ "summary": it.summary, "images": images(it) })).collect();
    let (heading, data) = (packed::text_in_html(title), packed::json_in_html(&data));
    document(title, "calibration", "", &fill(PAGE, &[("title", &heading), ("data", &data), ("script", SCRIPT)]))
}

/// Encodes the pixels of an image as runs: a value, and its number in a row.
fn runs(overlay: &Overlay) -> Vec<[u16; 2]> {
    let mut runs: Vec<[u16; 2]> = Vec::new();
    for (shown, predicted) in overlay.shown.iter().zip(&overlay.predicted) {
        let value = u16::from(*shown) + 2 * u16::from(*predicted);
        match runs.last_mut().filter(|[last, count]| *last == value && *count < u16::MAX) {
            Some([_, count]) => *count += 1,
            None => runs.push([value, 1]),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_that_are_alike_are_one_run() {
        let overlay = Overlay {
            width_px: 3,
            shown: vec![false, true, true, true, false, false],
            predicted: vec![false, false, true, true, true, false],
        };
        assert_eq!(runs(&overlay), [[0, 1], [1, 1], [3, 2], [2, 1], [0, 1]]);
        let page = page("a & b", &[CameraSection { summary: "</script>".to_owned(), overlays: vec![overlay] }]);
        assert!(page.contains("a &amp; b") && page.matches("</script>").count() == 2);
    }
}
