//! The cameras that see a flight.

use catch_body::InputError;
use catch_cell::{CameraModel, rig_from_toml};

/// Pixels of all images that are rendered at one time, at most: rendering takes some 350 bytes for each.
const MOST_PIXELS: u64 = 8_000_000;

/// Reads a rig whose images there is room for in each tick of a throw.
///
/// # Errors
/// If it is no rig, or a larger one.
pub fn read(file: &str, text: &str) -> Result<Vec<CameraModel>, InputError> {
    let cameras = rig_from_toml(file, text)?;
    let pixels: u64 = cameras.iter().map(|it| u64::from(it.width_px) * u64::from(it.height_px)).sum();
    if pixels <= MOST_PIXELS {
        return Ok(cameras);
    }
    let expected = format!("at most {} megapixels in all images of a flight together", MOST_PIXELS / 1_000_000);
    Err(InputError::new(file, "width_px × height_px", format!("{pixels} pixels"), expected))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_that_no_memory_holds_are_refused() {
        let rig = |width_px: u32| {
            format!(
                "[[cameras]]\nposition_m = [1.0, 1.0, 1.0]\nlook_at_m = [0.0, 0.0, 0.0]\nwidth_px = {width_px}\n\
                 height_px = 1000\nfocal_px = 1000.0\n"
            )
        };
        assert_eq!(read("r.toml", &rig(8000)).unwrap().len(), 1);
        let fault = read("r.toml", &rig(8001)).unwrap_err().to_string();
        assert!(fault.contains("8001000 pixels, expected at most 8 megapixels"), "{fault}");
    }
}
