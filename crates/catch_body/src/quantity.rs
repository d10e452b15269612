//! Checked quantities: the ranges that numbers in files may have, by what they measure.
//!
//! The type of a field names its quantity, whatever its shape (a number, an optional one, a list, a vector of
//! fixed length); the attribute [`checked`] has it read so:
//!
//! ```
//! use catch_body::{InputError, quantity};
//!
//! #[quantity::checked(deny_unknown_fields)]
//! #[derive(Debug, serde::Deserialize)]
//! struct Ball {
//!     mass_kg: quantity::thrown_mass_kg,
//!     position_m: quantity::place_m<[f64; 3]>,
//! }
//! let fault = InputError::parse_toml::<Ball>("ball.toml", "mass_kg = 58\nposition_m = [0, 0, 1]").unwrap_err();
//! assert_eq!(fault.to_string(), "ball.toml: mass_kg: found 58, expected 0.001 to 5 kg");
//! ```
//!
//! No range contains infinity or NaN. The ranges are wide: outside of them a file is in other units, or
//! nonsense.

use std::{
    fmt::{self, Display},
    marker::PhantomData,
};

pub use catch_quantity::checked;
use nalgebra::{Isometry3, SVector};
use serde::{
    Deserialize, Deserializer,
    de::{DeserializeSeed, Error, Expected, SeqAccess, Unexpected, Visitor},
};

/// A closed range of numbers with their unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity {
    /// The least.
    pub least: f64,
    /// The most.
    pub most: f64,
    /// The unit's symbol; empty for plain numbers.
    pub unit: &'static str,
}

impl Quantity {
    /// Returns whether `value` is within the range.
    pub fn contains(&self, value: f64) -> bool {
        (self.least..=self.most).contains(&value)
    }

    /// `value` if it is within the range.
    ///
    /// # Errors
    /// If it is not; `file` and `field` name the place.
    pub fn check(&self, file: &str, field: impl Display, value: f64) -> Result<f64, crate::InputError> {
        if self.contains(value) { Ok(value) } else { Err(crate::InputError::new(file, field, value, self)) }
    }
}

impl Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { least, most, unit } = self;
        if *most == f64::MAX {
            return f.write_str(if *least < 0.0 { "a finite number" } else { "a finite number, not negative" });
        }
        let space = if unit.is_empty() { "" } else { " " };
        write!(f, "{least} to {most}{space}{unit}")
    }
}

impl Expected for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Display::fmt(self, f)
    }
}

/// Numbers in any shape that can be read and checked against a range.
pub trait Numbers<'de>: Sized {
    /// Reads the numbers.
    ///
    /// # Errors
    /// One that is out of range, of another kind, or a list of another length.
    fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error>;
}

impl<'de> Numbers<'de> for f64 {
    fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error> {
        let value = Self::deserialize(from)?;
        if range.contains(value) { Ok(value) } else { Err(D::Error::invalid_value(Unexpected::Float(value), &range)) }
    }
}

/// Reads a whole number.
struct Whole(Quantity);

impl Visitor<'_> for Whole {
    type Value = u64;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "a whole number, {}", self.0)
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<u64, E> {
        let is_within = self.0.contains(value as f64);
        if is_within { Ok(value) } else { Err(E::invalid_value(Unexpected::Unsigned(value), &self.0)) }
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<u64, E> {
        let unsigned = u64::try_from(value).map_err(|_| E::invalid_type(Unexpected::Signed(value), &self))?;
        self.visit_u64(unsigned)
    }
}

macro_rules! whole_numbers {
    ($($whole:ty),*) => {$(
        impl<'de> Numbers<'de> for $whole {
            fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error> {
                let value = from.deserialize_u64(Whole(range))?;
                Self::try_from(value).map_err(|_| D::Error::invalid_value(Unexpected::Unsigned(value), &range))
            }
        }
    )*};
}

whole_numbers!(u32, usize);

impl<'de, T: Numbers<'de>> Numbers<'de> for Option<T> {
    fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error> {
        struct Optional<T>(Quantity, PhantomData<T>);
        impl<'de, T: Numbers<'de>> Visitor<'de> for Optional<T> {
            type Value = Option<T>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                Display::fmt(&self.0, f)
            }

            fn visit_none<E: Error>(self) -> Result<Self::Value, E> {
                Ok(None)
            }

            fn visit_unit<E: Error>(self) -> Result<Self::Value, E> {
                Ok(None)
            }

            fn visit_some<D: Deserializer<'de>>(self, from: D) -> Result<Self::Value, D::Error> {
                T::within(self.0, from).map(Some)
            }
        }
        from.deserialize_option(Optional(range, PhantomData))
    }
}

impl<'de, T: Numbers<'de>> Numbers<'de> for Vec<T> {
    fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error> {
        from.deserialize_seq(List { range, length: None, of: PhantomData })
    }
}

impl<'de, T: Numbers<'de>, const N: usize> Numbers<'de> for [T; N] {
    fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error> {
        let list = from.deserialize_tuple(N, List { range, length: Some(N), of: PhantomData })?;
        // The list has this length, or its reader has complained.
        list.try_into().map_err(|_| D::Error::custom(format_args!("a list of {N}")))
    }
}

impl<'de, const N: usize> Numbers<'de> for SVector<f64, N> {
    fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error> {
        <[f64; N]>::within(range, from).map(Self::from)
    }
}

impl<'de> Numbers<'de> for Isometry3<f64> {
    /// The range is that of the coordinates; the rotation is a unit quaternion.
    fn within<D: Deserializer<'de>>(range: Quantity, from: D) -> Result<Self, D::Error> {
        let pose = Self::deserialize(from)?;
        if let Some(value) = pose.translation.vector.iter().find(|value| !range.contains(**value)) {
            return Err(D::Error::invalid_value(Unexpected::Float(*value), &range));
        }
        let length = pose.rotation.quaternion().norm();
        if (length - 1.0).abs() <= 1e-6 {
            return Ok(pose);
        }
        Err(D::Error::invalid_value(Unexpected::Float(length), &"a quaternion of length 1"))
    }
}

/// Reads a list, of exactly `length` elements where that is set.
struct List<T> {
    range: Quantity,
    length: Option<usize>,
    of: PhantomData<T>,
}

impl<'de, T: Numbers<'de>> Visitor<'de> for List<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let length = self.length.map_or(String::new(), |length| format!(" of {length}"));
        write!(f, "a list{length}, each {}", self.range)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Self::Value, A::Error> {
        let mut list = Vec::new();
        // Elements beyond the length of the list are left to the reader to complain of.
        while self.length != Some(list.len())
            && let Some(element) = elements.next_element_seed(Element(self.range, PhantomData::<T>))?
        {
            list.push(element);
        }
        match self.length {
            Some(length) if length != list.len() => Err(A::Error::invalid_length(list.len(), &self)),
            _ => Ok(list),
        }
    }
}

/// Reads numbers that stand in a list or a table.
pub(crate) struct Element<T>(pub(crate) Quantity, pub(crate) PhantomData<T>);

impl<'de, T: Numbers<'de>> DeserializeSeed<'de> for Element<T> {
    type Value = T;

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<T, D::Error> {
        T::within(self.0, from)
    }
}

/// Any finite number: some files give zero, or a very large one, where nobody knows it.
pub const FINITE: Quantity = Quantity { least: -f64::MAX, most: f64::MAX, unit: "" };

macro_rules! quantities {
    ($($(#[$doc:meta])* $name:ident $constant:ident = $least:literal to $most:literal $unit:literal;)*) => {$(
        $(#[$doc])*
        pub const $constant: Quantity = Quantity { least: $least, most: $most, unit: $unit };

        $(#[$doc])*
        ///
        /// # Errors
        /// A value out of this range, or of another kind.
        pub fn $name<'de, D: Deserializer<'de>, T: Numbers<'de>>(from: D) -> Result<T, D::Error> {
            T::within($constant, from)
        }

        $(#[$doc])*
        #[expect(non_camel_case_types, reason = "called as the function that reads it")]
        pub type $name<T = f64> = T;
    )*};
}

quantities! {
    /// Coordinates of a place in or around a cell.
    place_m PLACE_M = -50.0 to 50.0 "m";
    /// Coordinates of a place on a body, such as a link or a gripper.
    offset_m OFFSET_M = -2.0 to 2.0 "m";
    /// Extents of a part.
    size_m SIZE_M = 0.001 to 2.0 "m";
    /// Radii of the parts of an arm.
    radius_m RADIUS_M = 0.001 to 0.5 "m";
    /// The extent of something that stands in a workcell. Thinner things could be passed through between two
    /// steps of the physics.
    obstacle_size_m OBSTACLE_SIZE_M = 0.01 to 50.0 "m";
    /// Distances within a cell.
    distance_m DISTANCE_M = 0.001 to 50.0 "m";
    /// Lengths and coordinates of a thrown object's shape.
    shape_m SHAPE_M = -1.0 to 1.0 "m";
    /// Diameters of a thrown object and radii of its bends, in whatever unit somebody took for metres.
    shape_size_m SHAPE_SIZE_M = 0.0001 to 1000.0 "m";
    /// Radii of a thrown object.
    shape_radius_m SHAPE_RADIUS_M = 0.0001 to 0.5 "m";
    /// Errors of a position.
    error_m ERROR_M = 0.0 to 1.0 "m";
    /// Angles, a turn at most.
    angle_rad ANGLE_RAD = -7.0 to 7.0 "rad";
    /// Angles, a turn at most.
    angle_deg ANGLE_DEG = -360.0 to 360.0 "degrees";
    /// Angles above the horizontal.
    elevation_deg ELEVATION_DEG = -90.0 to 90.0 "degrees";
    /// Angles of an arc.
    arc_deg ARC_DEG = 0.1 to 360.0 "degrees";
    /// Errors of an angle.
    error_rad ERROR_RAD = 0.0 to 1.0 "rad";
    /// Errors of an angle.
    error_deg ERROR_DEG = 0.0 to 60.0 "degrees";
    /// Shears of a velocity.
    shear SHEAR = -10.0 to 10.0 "";
    /// Parts of a unit quaternion.
    quaternion QUATERNION = -1.001 to 1.001 "";
    /// Coordinates of a direction.
    coordinate COORDINATE = -1000.0 to 1000.0 "";
    /// Variances and covariances of a pose.
    pose_covariance POSE_COVARIANCE = -1.0 to 1.0 "rad², rad·m or m²";
    /// Errors of a scale, as a fraction.
    scale_error SCALE_ERROR = -0.5 to 0.5 "";
    /// Times between two clocks.
    time_offset_s TIME_OFFSET_S = -1.0 to 1.0 "s";
    /// Standard deviations of such times.
    time_sd_s TIME_SD_S = 0.0 to 1.0 "s";
    /// Errors of an inverse depth.
    inverse_depth_per_m INVERSE_DEPTH_PER_M = 0.0 to 10.0 "1/m";
    /// Masses of parts of a robot.
    part_mass_kg PART_MASS_KG = 0.000001 to 1000.0 "kg";
    /// Masses of what is thrown.
    thrown_mass_kg THROWN_MASS_KG = 0.001 to 5.0 "kg";
    /// Times on the clock of a cell.
    clock_s CLOCK_S = -1e11 to 1e11 "s";
    /// Poses in or around a cell.
    pose POSE = -50.0 to 50.0 "m";
    /// Positions of joints as they are sensed and commanded.
    joint_rad JOINT_RAD = -1000.0 to 1000.0 "rad";
    /// Limits of the positions of joints.
    joint_position_rad JOINT_POSITION_RAD = -100.0 to 100.0 "rad";
    /// Velocities of joints as they are sensed and commanded.
    joint_radps JOINT_RADPS = -1e5 to 1e5 "rad/s";
    /// Accelerations of joints as they are commanded.
    joint_radps2 JOINT_RADPS2 = -1e8 to 1e8 "rad/s²";
    /// Positions of fingers as they are sensed and commanded.
    drive_m DRIVE_M = -10.0 to 10.0 "m";
    /// Velocities of fingers as they are sensed and commanded.
    drive_mps DRIVE_MPS = -1000.0 to 1000.0 "m/s";
    /// Forces of fingers as they are sensed and commanded.
    drive_n DRIVE_N = -1e6 to 1e6 "N";
    /// Values of a simulated state, which may have diverged.
    true_value TRUE_VALUE = -1e12 to 1e12 "";
    /// Poses of a simulated state, which may have diverged.
    true_pose TRUE_POSE = -1e12 to 1e12 "m";
    /// Numbers of cameras in a rig.
    camera_number CAMERA_NUMBER = 0.0 to 1000.0 "";
    /// Columns and rows of images.
    pixel PIXEL = 0.0 to 8192.0 "pixels";
    /// Moments and products of inertia.
    inertia_kgm2 INERTIA_KGM2 = -1000.0 to 1000.0 "kg·m²";
    /// Principal moments of inertia.
    moment_kgm2 MOMENT_KGM2 = 0.000000001 to 1000.0 "kg·m²";
    /// Inertias of rotors, reflected to the joint.
    rotor_inertia_kgm2 ROTOR_INERTIA_KGM2 = 0.0 to 1000.0 "kg·m²";
    /// Forces of a gripper.
    force_n FORCE_N = 0.01 to 100000.0 "N";
    /// Stiffnesses of surfaces.
    stiffness_npm STIFFNESS_NPM = 1.0 to 1000000000.0 "N/m";
    /// Torques of joints.
    torque_nm TORQUE_NM = 0.001 to 100000.0 "N·m";
    /// Gains of a joint's controller.
    gain GAIN = 0.0 to 1000000.0 "";
    /// Viscous damping of joints.
    damping_nmsprad DAMPING_NMSPRAD = 0.0 to 10000.0 "N·m·s/rad";
    /// Speeds of drives.
    drive_speed_mps DRIVE_SPEED_MPS = 0.001 to 100.0 "m/s";
    /// Accelerations of drives.
    drive_acceleration_mps2 DRIVE_ACCELERATION_MPS2 = 0.001 to 10000000.0 "m/s²";
    /// Velocities of what flies.
    velocity_mps VELOCITY_MPS = -50.0 to 50.0 "m/s";
    /// Velocities of the air.
    wind_mps WIND_MPS = -60.0 to 60.0 "m/s";
    /// Angular velocities of what flies.
    spin_radps SPIN_RADPS = -200.0 to 200.0 "rad/s";
    /// Magnitudes of the same.
    speed_radps SPEED_RADPS = 0.0 to 200.0 "rad/s";
    /// Velocities of joints.
    joint_velocity_radps JOINT_VELOCITY_RADPS = 0.001 to 1000.0 "rad/s";
    /// Highest speeds of hands.
    hand_speed_mps HAND_SPEED_MPS = 0.01 to 100.0 "m/s";
    /// Velocities of joints with their direction.
    signed_joint_velocity_radps SIGNED_JOINT_VELOCITY_RADPS = -1000.0 to 1000.0 "rad/s";
    /// Accelerations of joints.
    joint_acceleration_radps2 JOINT_ACCELERATION_RADPS2 = 0.001 to 1000000.0 "rad/s²";
    /// Jerks of joints.
    joint_jerk_radps3 JOINT_JERK_RADPS3 = 0.001 to 1000000000.0 "rad/s³";
    /// Drag constants k of a = −k·|v|·v.
    drag_per_m DRAG_PER_M = 0.0 to 10.0 "1/m";
    /// Magnus coefficients c of a = c·ω×v.
    magnus MAGNUS = 0.0 to 1.0 "";
    /// Rates at which something decays.
    decay_per_s DECAY_PER_S = 0.0 to 100.0 "1/s";
    /// Poses of the arm in a calibration.
    poses POSES = 3.0 to 100.0 "";
    /// Images of a camera before anything flies.
    background_images BACKGROUND_IMAGES = 0.0 to 100.0 "";
    /// Flights that refine a calibration.
    flights FLIGHTS = 0.0 to 200.0 "";
    /// Fractions.
    fraction FRACTION = 0.0 to 1.0 "";
    /// Fractions by which something is drawn around its mean, below one.
    spread SPREAD = 0.0 to 0.99 "";
    /// Weights of a choice.
    weight WEIGHT = 0.0 to 1000000000.0 "";
    /// Cosines.
    cosine COSINE = -1.0 to 1.0 "";
    /// Fractions of a limit that a plan may use.
    limit_scaling LIMIT_SCALING = 0.01 to 1.0 "";
    /// Densities of white noise of an acceleration.
    noise_density NOISE_DENSITY = 0.0 to 1000.0 "";
    /// Factors.
    factor FACTOR = 0.0 to 1000.0 "";
    /// Metres per unit of a file.
    scale SCALE = 0.000001 to 1000.0 "m per unit";
    /// Factors on limits.
    limit_factor LIMIT_FACTOR = 0.001 to 1000000.0 "";
    /// Friction coefficients.
    friction FRICTION = 0.0 to 100.0 "";
    /// Rates of cameras and drives.
    rate_hz RATE_HZ = 1.0 to 10000.0 "Hz";
    /// Times that something takes within a flight.
    latency_s LATENCY_S = 0.0 to 0.5 "s, a time within a flight";
    /// Times that something takes within a flight, in milliseconds.
    latency_ms LATENCY_MS = 0.0 to 500.0 "ms, a time within a flight";
    /// Times of flight, within that of a trial.
    flight_s FLIGHT_S = 0.1 to 1.9 "s";
    /// Steps of a simulation.
    step_s STEP_S = 0.00001 to 0.002 "s, beyond which contacts are wrong";
    /// Widths and heights of images.
    image_px IMAGE_PX = 1.0 to 8192.0 "pixels";
    /// Focal lengths.
    focal_px FOCAL_PX = 1.0 to 1000000.0 "pixels";
    /// Image coordinates, in an image or beside it.
    image_coordinate_px IMAGE_COORDINATE_PX = -100000.0 to 100000.0 "pixels";
    /// Errors in an image.
    error_px ERROR_PX = 0.0 to 100.0 "pixels";
    /// Widths of what lies along an edge in an image.
    edge_px EDGE_PX = 0.0 to 8.0 "pixels";
    /// Angles between a ray and a surface's normal.
    incidence_rad INCIDENCE_RAD = 0.0 to 1.6 "rad";
    /// Fields of view.
    field_of_view_deg FIELD_OF_VIEW_DEG = 0.1 to 175.0 "degrees";
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{InputError, quantity};

    #[quantity::checked(deny_unknown_fields)]
    #[derive(Debug, PartialEq, Deserialize)]
    struct File {
        size_m: quantity::size_m<[f64; 3]>,
        ratio: quantity::fraction<Option<f64>>,
        #[serde(default)]
        profile_m: quantity::shape_m<Vec<[f64; 2]>>,
        #[serde(default = "one")]
        width_px: quantity::image_px<u32>,
    }

    fn one() -> u32 {
        1
    }

    #[test]
    fn any_shape_of_numbers_is_checked() {
        let read = |text: &str| InputError::parse_toml::<File>("f.toml", text);
        let right = read("size_m = [1, 0.5, 2.0]\nprofile_m = [[0.0, 0.1]]\nratio = 1").unwrap();
        assert_eq!(right, File { size_m: [1.0, 0.5, 2.0], ratio: Some(1.0), profile_m: vec![[0.0, 0.1]], width_px: 1 });
        for (text, said) in [
            ("", "size_m: found an empty file, expected "),
            ("size_m = [1, 1, 1, 7]", "size_m: found [1, 1, 1, 7], expected a list of 3"),
            ("size_m = [1, 1]", "size_m: found [1, 1], expected a list of 3"),
            ("size_m = [1, 1e300, 1]", "size_m[1]: found 1e300, expected 0.001 to 2 m"),
            ("size_m = [1, nan, 1]", "size_m[1]: found nan, expected a finite number"),
            ("size_m = 3", "size_m: found 3, expected a list of 3, each 0.001 to 2 m"),
            ("size_m = [1, \"2\", 1]", "size_m[1]: found \"2\", expected a number"),
            ("size_m = [1, 1, 1]\nratio = -1", "ratio: found -1, expected 0 to 1"),
            (
                "size_m = [1, 1, 1]\nprofile_m = [[0, 1], [0, 1, 2]]",
                "profile_m[1]: found [0, 1, 2], expected a list of 2",
            ),
            ("size_m = [1, 1, 1]\nprofile_m = [[0, 5]]", "profile_m[0][1]: found 5, expected -1 to 1 m"),
            ("size_m = [1, 1, 1]\nwidth_px = 9000", "width_px: found 9000, expected 1 to 8192 pixels"),
            ("size_m = [1, 1, 1]\nwidth_px = -1", "width_px: found -1, expected a whole number, 1 to 8192 pixels"),
            (
                "size_m = [1, 1, 1]\nwidth_px = 100_000_000_000_000_000_000",
                "width_px: found 1e20, expected a whole number, 1 to",
            ),
        ] {
            let fault = read(text).unwrap_err().to_string();
            assert!(fault.starts_with(&format!("f.toml: {said}")), "{fault}");
        }
    }
}
