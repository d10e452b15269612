//! Placed cameras as one page: the cell from above, and what each camera shows of sampled flights.

use std::fmt::Write;

use catch_body::Pose;
use catch_cell::{CameraModel, DepthFrame};
use nalgebra::Point3;

use super::{document, packed};
use catch_lab::camera_placement::SampledFlight;

/// Flights that are drawn, at most.
const MOST_FLIGHTS: usize = 30;
/// Pixels of a metre in the view from above.
const SCALE_PX: f64 = 110.0;
/// Columns and rows of an image that become one square of the arm.
const SQUARE_PX: usize = 8;

/// A camera on the page.
#[derive(Debug)]
pub struct CameraView<'a> {
    /// Model and pose of the camera.
    pub camera: &'a CameraModel,
    /// Summary of the camera's view, in a line.
    pub summary: String,
    /// Instants of each flight at which the camera shows the object.
    pub sight: Vec<Vec<bool>>,
    /// A whole image of the waiting arm.
    pub image: DepthFrame,
}

/// The page.
pub fn page(title: &str, flights: &[SampledFlight], views: &[CameraView]) -> String {
    let mut body = format!(
        "<main><h1>{}</h1><h2>From above</h2><p>Green: shown by two cameras or more; orange: by one; grey: by none. x points \
         to the right and y up, the base of the arm is the cross.</p>",
        packed::text_in_html(title)
    );
    body += &from_above(flights, views);
    for (i, view) in views.iter().enumerate() {
        let summary = packed::text_in_html(&view.summary);
        let _ = write!(body, "<h2>Camera {i}</h2><p>{summary}</p>{}", image(flights, view));
    }
    document(title, "placement", "", &(body + "</main>"))
}

fn from_above(flights: &[SampledFlight], views: &[CameraView]) -> String {
    let cameras = views.iter().map(|it| Point3::from(it.camera.X_WC.translation.vector));
    let flown = flights.iter().take(MOST_FLIGHTS).flat_map(|it| it.p_WO.iter().copied());
    let (mut low, mut high) = ([-0.5_f64; 2], [0.5_f64; 2]);
    for p in flown.chain(cameras) {
        for axis in 0..2 {
            low[axis] = low[axis].min(p[axis] - 0.3);
            high[axis] = high[axis].max(p[axis] + 0.3);
        }
    }
    let at = |p: &Point3<f64>| [(p.x - low[0]) * SCALE_PX, (high[1] - p.y) * SCALE_PX];
    let mut svg = svg([(high[0] - low[0]) * SCALE_PX, (high[1] - low[1]) * SCALE_PX]);
    for (throw, flight) in flights.iter().take(MOST_FLIGHTS).enumerate() {
        for (tick, p) in flight.p_WO.iter().enumerate() {
            let seeing = views.iter().filter(|it| it.sight[throw][tick]).count();
            dot(&mut svg, at(p), 2.0, ["#999", "#d80", "#291"][seeing.min(2)]);
        }
    }
    for (i, view) in views.iter().enumerate() {
        let X_WC: &Pose = &view.camera.X_WC;
        let eye = Point3::from(X_WC.translation.vector);
        let half = f64::from(view.camera.width_px) / 2.0 / view.camera.focal_px;
        let [a, b] = [-half, half].map(|x| at(&(X_WC * Point3::new(x, 0.0, 1.0))));
        let [x, y] = at(&eye);
        let _ = write!(
            svg,
            "<path d=\"M{x:.1} {y:.1}L{:.1} {:.1}L{:.1} {:.1}Z\" fill=\"#36c2\" stroke=\"#36c\"/><text x=\"{x:.1}\" y=\"{:.1}\" \
             font-size=\"14\">{i}: {:.2} m high</text>",
            a[0],
            a[1],
            b[0],
            b[1],
            y - 6.0,
            eye.z
        );
    }
    let [x, y] = at(&Point3::origin());
    let _ = write!(svg, "<path d=\"M{} {y}h12M{x} {}v12\" stroke=\"#000\" stroke-width=\"2\"/>", x - 6.0, y - 6.0);
    svg + "</svg>"
}

fn image(flights: &[SampledFlight], view: &CameraView) -> String {
    let CameraView { camera, sight, image, .. } = view;
    let (width, height) = (camera.width_px as usize, camera.height_px as usize);
    let mut svg = svg([width as f64, height as f64]);
    for row in (0..height).step_by(SQUARE_PX) {
        for column in (0..width).step_by(SQUARE_PX) {
            if image.depth_m.get(row * width + column).is_some_and(|depth| depth.is_finite()) {
                let _ = write!(
                    svg,
                    "<rect x=\"{column}\" y=\"{row}\" width=\"{SQUARE_PX}\" height=\"{SQUARE_PX}\" fill=\"#36c6\"/>"
                );
            }
        }
    }
    for (flight, shown) in flights.iter().zip(sight).take(MOST_FLIGHTS) {
        for (p_WO, shown) in flight.p_WO.iter().zip(shown) {
            let Some(uv) = camera.project(&camera.X_WC.inverse_transform_point(p_WO)) else { continue };
            if (0.0..width as f64).contains(&uv.x) && (0.0..height as f64).contains(&uv.y) {
                dot(&mut svg, [uv.x, uv.y], 3.0, if *shown { "#291" } else { "#999" });
            }
        }
    }
    svg + "</svg>"
}

fn svg([width, height]: [f64; 2]) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" \
         style=\"max-width:100%;background:#f4f4f4;border:1px solid #888\">"
    )
}

fn dot(svg: &mut String, [x, y]: [f64; 2], radius: f64, colour: &str) {
    let _ = write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{colour}\"/>");
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_cell::PixelWindow;

    #[test]
    fn a_page_shows_cameras_and_flights() {
        let camera = CameraModel::with_field_of_view(Pose::identity(), 16, 16, 1.0);
        let flights =
            [SampledFlight { p_WO: vec![Point3::new(0.0, 0.0, 1.0), Point3::new(9.0, 0.0, 1.0)], catch_s: 0.01 }];
        let window = PixelWindow { left: 0, top: 0, width: 16, height: 16 };
        let mut depth_m = vec![f32::NAN; 256];
        depth_m[0] = 1.0;
        let image = DepthFrame { camera: 0, capture_s: 0.0, window, depth_m, mask: None };
        let view = CameraView { camera: &camera, summary: "a < b".to_owned(), sight: vec![vec![true, false]], image };
        let page = page("two & two", &flights, &[view]);
        assert!(page.contains("two &amp; two") && page.contains("a &lt; b"));
        assert_eq!((page.matches("#d80").count(), page.matches("<rect").count()), (1, 1));
        assert_eq!(page.matches("r=\"3\"").count(), 1, "what is beside the image is not drawn in it");
    }
}
