//! Depth images of an object that stands still, with the cameras that took them: a scan as people have it.

use std::{fs, path::Path};

use catch_body::TriangleMesh;
use catch_cell::{reference_scan, rig_from_toml};
use png::{BitDepth, ColorType, Encoder};

/// Twelve cameras around the origin.
pub const RIG: &str = "\
[uv_sphere]
radius_m = 0.5
azimuths_deg = [0.0, 90.0, 180.0, 270.0]
elevations_deg = [55.0, 0.0, -55.0]
look_at_m = [0.0, 0.0, 0.0]
width_px = 320
height_px = 240
vertical_fov_deg = 30.0
";

/// Writes a scan of `mesh`, which is in metres, to a folder that is not there yet. Pixels beside the object
/// show a wall every other image, otherwise nothing.
pub fn write(folder: &Path, mesh: &TriangleMesh) {
    fs::create_dir(folder).unwrap();
    fs::write(folder.join("rig.toml"), RIG).unwrap();
    let cameras = rig_from_toml("rig.toml", RIG).unwrap();
    for frame in reference_scan(mesh, &cameras).frames {
        let camera = &cameras[frame.camera];
        let (width, height, window) = (camera.width_px, camera.height_px, frame.window);
        let mut depths = vec![if frame.camera % 2 == 0 { 1500 } else { 0 }; (width * height) as usize];
        for (i, depth_m) in frame.depth_m.iter().enumerate().filter(|(_, it)| it.is_finite()) {
            let (column, row) = (i as u32 % window.width, i as u32 / window.width);
            depths[((window.top + row) * width + window.left + column) as usize] = (1e3 * depth_m).round() as u16;
        }
        fs::write(folder.join(format!("depth_{}.png", frame.camera)), gray16(width, height, &depths)).unwrap();
    }
}

/// A PNG image with one channel of 16 bits.
pub fn gray16(width: u32, height: u32, values: &[u16]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, width, height);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Sixteen);
    let bytes: Vec<u8> = values.iter().flat_map(|it| it.to_be_bytes()).collect();
    encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
    file
}
