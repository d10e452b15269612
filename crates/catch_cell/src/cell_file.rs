//! A real cell's file: links to arm, hand and cameras, and the bounds of the motion.

use catch_body::{InputError, quantity};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// A CELL.toml.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CellFile {
    /// Scenario whose settings the brain gets: a built-in name or a file.
    pub scenario: String,
    /// Arm: a built-in name or a file.
    pub robot: String,
    /// Gripper: a built-in name or a file.
    pub gripper: String,
    /// Surroundings of the arm: a built-in name or a file.
    pub workcell: Option<String>,
    /// Object that is thrown: a built-in name or a file.
    pub object: String,
    /// Calibrated cameras: a rig's file.
    pub rig: String,
    /// Fraction of the limits of velocity, acceleration and jerk that motions may use.
    #[serde(default = "first_speed_scaling")]
    pub speed_scaling: quantity::limit_scaling,
    /// Link to the arm.
    pub arm: ArmLink,
    /// Link to the gripper, where it has one of its own.
    pub hand: Option<HandLink>,
    /// Link to the cameras.
    pub cameras: CameraLink,
    /// Box that the hand must not leave.
    pub safe_box: SafeBox,
}

/// Speed of the first motions of a cell that nobody has tried.
fn first_speed_scaling() -> f64 {
    0.1
}

/// Link to an arm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmLink {
    /// Name of the driver's program.
    pub driver: String,
    /// Network address of the robot controller; for `catch_ros2` the controller's name.
    pub address: String,
}

/// Link to a gripper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandLink {
    /// Protocol that it speaks, by a name of the arm's driver. By default: the driver's first.
    pub driver: Option<String>,
    /// Network address.
    pub address: String,
}

/// Link to the cameras.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraLink {
    /// Path of the Unix socket at which the driver waits for images.
    pub socket: String,
}

/// A box in the world.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SafeBox {
    /// The corner with the least coordinates.
    pub low_m: quantity::place_m<[f64; 3]>,
    /// The corner with the highest coordinates.
    pub high_m: quantity::place_m<[f64; 3]>,
}

impl SafeBox {
    /// Returns whether a point of the world is inside.
    pub fn contains(&self, p_W: &Point3<f64>) -> bool {
        (0..3).all(|i| (self.low_m[i]..=self.high_m[i]).contains(&p_W[i]))
    }
}

impl CellFile {
    /// Reads a cell's file; `file` names it in errors.
    ///
    /// # Errors
    /// A field that is missing, misspelt or out of range.
    pub fn from_toml(file: &str, text: &str) -> Result<Self, InputError> {
        let cell: Self = InputError::parse_toml(file, text)?;
        let SafeBox { low_m, high_m } = cell.safe_box;
        if let Some(i) = (0..3).find(|&i| low_m[i] >= high_m[i]) {
            let expected = format!("more than safe_box.low_m[{i}], which is {}", low_m[i]);
            return Err(InputError::new(file, format!("safe_box.high_m[{i}]"), high_m[i], expected));
        }
        let hand = cell.hand.iter().map(|it| {
            (
                "hand.address",
                &it.address,
                "the gripper's network address, such as 172.16.0.2; or no table [hand] at all",
            )
        });
        let others = [
            ("arm.driver", &cell.arm.driver, "a program's name, such as catch_franka"),
            ("arm.address", &cell.arm.address, "the robot controller's network address, such as 172.16.0.2"),
            ("cameras.socket", &cell.cameras.socket, "a socket's path, such as /tmp/catchingbot-cameras"),
        ];
        for (field, value, expected) in others.into_iter().chain(hand) {
            if value.is_empty() || value.contains(char::is_whitespace) {
                return Err(InputError::new(file, field, format!("{value:?}"), expected));
            }
        }
        Ok(cell)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
        scenario = "lab"
        robot = "fr3"
        gripper = "franka_hand"
        object = "tennis_ball"
        rig = "rig.toml"
        [arm]
        driver = "catch_franka"
        address = "172.16.0.2"
        [cameras]
        socket = "/tmp/cameras"
        [safe_box]
        low_m = [-0.2, -0.6, 0.1]
        high_m = [0.8, 0.6, 1.0]
    "#;

    #[test]
    fn a_cell_begins_at_a_tenth_of_its_speed() {
        let cell = CellFile::from_toml("cell.toml", TEXT).unwrap();
        assert_eq!((cell.speed_scaling, cell.arm.driver.as_str(), cell.hand), (0.1, "catch_franka", None));
        assert!(cell.safe_box.contains(&Point3::new(0.5, 0.0, 0.5)));
        assert!(!cell.safe_box.contains(&Point3::new(0.5, 0.0, 0.05)));
    }

    #[test]
    fn every_fault_names_file_field_and_value() {
        for (right, wrong, said) in [
            ("[0.8,", "[-0.3,", "cell.toml: safe_box.high_m[0]: found -0.3, expected more than safe_box.low_m[0]"),
            ("driver = \"catch_franka\"", "driver = \"\"", "cell.toml: arm.driver: found \"\""),
            (
                "172.16.0.2",
                "172.16.0.2 ",
                "arm.address: found \"172.16.0.2 \", expected the robot controller's network",
            ),
            ("address = \"172.16.0.2\"", "address = \"\"", "cell.toml: arm.address: found \"\""),
            (
                "[cameras]",
                "[hand]\naddress = \"\"\n[cameras]",
                "cell.toml: hand.address: found \"\", expected the gripper's",
            ),
            ("/tmp/cameras", "", "cell.toml: cameras.socket: found \"\""),
            ("socket", "sokcet", "sokcet"),
            ("[arm]", "speed_scaling = 11.0\n[arm]", "speed_scaling: found 11"),
            ("high_m = [0.8, ", "high_m = [", "safe_box.high_m"),
        ] {
            assert!(TEXT.contains(right), "{right}");
            let fault = CellFile::from_toml("cell.toml", &TEXT.replacen(right, wrong, 1)).unwrap_err().to_string();
            assert!(fault.contains(said), "{fault}");
        }
    }
}
