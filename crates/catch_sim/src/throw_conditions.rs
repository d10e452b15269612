//! The arena's own account of what it drew for a throw: for recordings, rows and documents, never for the
//! brain.
//!
//! Frames: W is the world, O the object as its file has it, G the gripper, M where the model of the arm has
//! the gripper mounted.

use catch_body::{Pose, quantity};
use serde::{Deserialize, Serialize};

use crate::{conditions::Conditions, object::ThrownObject, throw::Release};

/// All that was drawn for a throw, and what it was drawn around.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ThrowConditions {
    /// Conditions of the object and its flight.
    #[serde(flatten)]
    pub flight: FlightConditions,
    /// Conditions of arm, gripper and cameras.
    #[serde(flatten)]
    pub cell: CellConditions,
}

/// Conditions of the object, its flight and its contacts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlightConditions {
    /// Release of the object from the thrower's hand.
    pub release: ReleaseState,
    /// Coulomb friction coefficient of all contacts.
    #[serde(deserialize_with = "quantity::true_value")]
    pub friction: f64,
    /// Coefficient of restitution of all contacts.
    #[serde(deserialize_with = "quantity::true_value")]
    pub restitution: f64,
    /// Drag constant k of a = −k·|u|·u in 1/m, u the velocity relative to the air; zero without air.
    #[serde(deserialize_with = "quantity::true_value")]
    pub drag_per_m: f64,
    /// Mass in kg.
    #[serde(deserialize_with = "quantity::true_value")]
    pub mass_kg: f64,
    /// Velocity of the air in W, in m/s.
    #[serde(deserialize_with = "quantity::true_value")]
    pub wind_mps: [f64; 3],
    /// Centre of mass in O, in metres.
    #[serde(deserialize_with = "quantity::true_value")]
    pub com_m: [f64; 3],
    /// Rotational inertia about the centre of mass along the axes of O, row by row, in kg·m².
    #[serde(deserialize_with = "quantity::true_value")]
    pub inertia_kgm2: [[f64; 3]; 3],
    /// Deviation E of the drag matrix k·(1 + E) along the axes of O, row by row.
    #[serde(deserialize_with = "quantity::true_value")]
    pub drag_deviation: [[f64; 3]; 3],
    /// Magnus coefficient c of a = c·ω×u.
    #[serde(deserialize_with = "quantity::true_value")]
    pub magnus: f64,
    /// Decay c of the spin, ω̇ = −c·ω, in 1/s.
    #[serde(deserialize_with = "quantity::true_value")]
    pub spin_decay_per_s: f64,
}

/// State of the object when it is released.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReleaseState {
    /// Origin of O in W, in metres.
    #[serde(deserialize_with = "quantity::true_value")]
    pub position_m: [f64; 3],
    /// Orientation of O in W, a unit quaternion x, y, z, w.
    #[serde(deserialize_with = "quantity::true_value")]
    pub orientation_xyzw: [f64; 4],
    /// Velocity of that origin in W, in m/s.
    #[serde(deserialize_with = "quantity::true_value")]
    pub velocity_mps: [f64; 3],
    /// Angular velocity in W, in rad/s.
    #[serde(deserialize_with = "quantity::true_value")]
    pub spin_radps: [f64; 3],
    /// True if the object flies along a recorded track until something touches it.
    pub is_recorded: bool,
}

/// Conditions of arm, gripper and cameras.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CellConditions {
    /// Mass of each link over that in the model, base to tip.
    #[serde(deserialize_with = "quantity::true_value")]
    pub link_mass_ratios: Vec<f64>,
    /// True pose of the gripper: G in M.
    pub gripper_mount: FramePose,
    /// Time of the first cycle of the gripper's connection, in seconds on the cell's clock; none for one
    /// without cycles.
    #[serde(deserialize_with = "quantity::true_value")]
    pub gripper_phase_s: Option<f64>,
    /// True poses of the cameras, in the order of the rig.
    pub cameras: Vec<CameraPose>,
    /// Fraction of the object's surface that gives no depth.
    #[serde(deserialize_with = "quantity::true_value")]
    pub hole_fraction: f64,
}

/// Pose of a frame in another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FramePose {
    /// Position in metres.
    #[serde(deserialize_with = "quantity::true_value")]
    pub position_m: [f64; 3],
    /// Orientation, a unit quaternion x, y, z, w.
    #[serde(deserialize_with = "quantity::true_value")]
    pub orientation_xyzw: [f64; 4],
}

/// Pose of a camera in W, z forward and y down, and its place in time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CameraPose {
    /// The pose.
    #[serde(flatten)]
    pub pose: FramePose,
    /// Time at which the first image of a free-running camera is due, in seconds; none for one that takes an
    /// image at every observation.
    #[serde(default, deserialize_with = "quantity::true_value", skip_serializing_if = "Option::is_none")]
    pub phase_s: Option<f64>,
}

impl From<&Pose> for FramePose {
    fn from(pose: &Pose) -> Self {
        // nalgebra keeps quaternions in this order, too.
        Self { position_m: pose.translation.vector.into(), orientation_xyzw: pose.rotation.coords.into() }
    }
}

impl FlightConditions {
    /// Conditions of an object that is released so under these conditions.
    pub fn of(object: &ThrownObject, release: &Release, conditions: &Conditions) -> Self {
        let rows = |matrix: &nalgebra::Matrix3<f64>| matrix.transpose().into();
        Self {
            release: ReleaseState {
                position_m: release.p_WO.coords.into(),
                orientation_xyzw: release.q_WO.coords.into(),
                velocity_mps: release.v_WO.into(),
                spin_radps: release.omega_WO.into(),
                is_recorded: release.path.is_some(),
            },
            friction: conditions.friction,
            restitution: conditions.restitution,
            drag_per_m: conditions.drag_per_m,
            mass_kg: object.mass_kg,
            wind_mps: conditions.wind_mps.into(),
            com_m: object.com_O.coords.into(),
            inertia_kgm2: rows(&object.inertia_kgm2),
            drag_deviation: rows(&conditions.aerodynamics.drag_deviation_O),
            magnus: conditions.aerodynamics.magnus,
            spin_decay_per_s: conditions.aerodynamics.spin_decay_per_s,
        }
    }
}
