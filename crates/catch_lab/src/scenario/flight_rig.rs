//! The cameras that see a flight.

use catch_body::{InputError, Robot, shape::Capsule};
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

/// Checks that all cameras stand outside of the arm's base and of the obstacles; `file` is the rig's.
///
/// # Errors
/// If one does not: it would see nothing else.
pub fn check_clear(file: &str, cameras: &[CameraModel], robot: &Robot) -> Result<(), InputError> {
    let base = robot.link_poses(&robot.ready_q)[0];
    for (i, camera) in cameras.iter().enumerate() {
        let at = nalgebra::Point3::from(camera.X_WC.translation.vector);
        let in_base =
            robot.capsules.iter().any(|(link, it)| *link == 0 && it.transformed(&base).distance_to_point(&at) <= 0.0);
        let point = Capsule { from: at, to: at, radius: 0.0 };
        let obstacle = robot.obstacles.iter().find(|it| it.distance_to_capsule(&point) <= 0.0);
        let within = in_base.then_some("the arm's base").or(obstacle.map(|it| it.name.as_str()));
        if let Some(within) = within {
            let field = format!("cameras[{i}].position_m");
            let expected = format!("a place outside of {within}");
            return Err(InputError::new(file, field, format!("[{:.3}, {:.3}, {:.3}]", at.x, at.y, at.z), expected));
        }
    }
    Ok(())
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

    #[test]
    fn cameras_within_solids_are_refused() {
        use crate::scenario::setup::{Choice, Setup};
        let choice = Choice { workcell: Some("table_and_fence"), ..Choice::default() };
        let Setup { robot, mut cameras, .. } = Setup::load(&choice).unwrap();
        check_clear("r.toml", &cameras, &robot).unwrap();
        let (_, base) = robot.capsules.iter().find(|(link, _)| *link == 0).unwrap();
        let in_base = robot.link_poses(&robot.ready_q)[0] * nalgebra::center(&base.from, &base.to);
        let table = robot.obstacles[0].mesh().aabb().centre;
        for (at, within) in [(in_base, "the arm's base"), (table, robot.obstacles[0].name.as_str())] {
            cameras[1].X_WC.translation.vector = at.coords;
            let fault = check_clear("r.toml", &cameras, &robot).unwrap_err().to_string();
            assert!(fault.contains(&format!("a place outside of {within}")), "{fault}");
            assert!(fault.contains("cameras[1].position_m"), "{fault}");
        }
    }
}
