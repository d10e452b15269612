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
#[quantity::checked]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlightConditions {
    /// Release of the object from the thrower's hand.
    pub release: ReleaseState,
    /// Coulomb friction coefficient of all contacts.
    pub friction: quantity::true_value,
    /// Coefficient of restitution of all contacts.
    pub restitution: quantity::true_value,
    /// Drag constant k of a = −k·|u|·u in 1/m, u the velocity relative to the air; zero without air.
    pub drag_per_m: quantity::true_value,
    /// Mass in kg.
    pub mass_kg: quantity::true_value,
    /// Velocity of the air in W, in m/s.
    pub wind_mps: quantity::true_value<[f64; 3]>,
    /// Centre of mass in O, in metres.
    pub com_m: quantity::true_value<[f64; 3]>,
    /// Rotational inertia about the centre of mass along the axes of O, row by row, in kg·m².
    pub inertia_kgm2: quantity::true_value<[[f64; 3]; 3]>,
    /// Deviation E of the drag matrix k·(1 + E) along the axes of O, row by row.
    pub drag_deviation: quantity::true_value<[[f64; 3]; 3]>,
    /// Magnus coefficient c of a = c·ω×u.
    pub magnus: quantity::true_value,
    /// Decay c of the spin, ω̇ = −c·ω, in 1/s.
    pub spin_decay_per_s: quantity::true_value,
}

/// State of the object when it is released.
#[quantity::checked]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReleaseState {
    /// Origin of O in W, in metres.
    pub position_m: quantity::true_value<[f64; 3]>,
    /// Orientation of O in W, a unit quaternion x, y, z, w.
    pub orientation_xyzw: quantity::true_value<[f64; 4]>,
    /// Velocity of that origin in W, in m/s.
    pub velocity_mps: quantity::true_value<[f64; 3]>,
    /// Angular velocity in W, in rad/s.
    pub spin_radps: quantity::true_value<[f64; 3]>,
    /// True if the object flies along a recorded track until something touches it.
    pub is_recorded: bool,
}

/// Conditions of arm, gripper and cameras.
#[quantity::checked]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CellConditions {
    /// Mass of each link over that in the model, base to tip.
    pub link_mass_ratios: quantity::true_value<Vec<f64>>,
    /// True pose of the gripper: G in M.
    pub gripper_mount: FramePose,
    /// Time of the first cycle of the gripper's connection, in seconds on the cell's clock; none for one
    /// without cycles.
    pub gripper_phase_s: quantity::true_value<Option<f64>>,
    /// True poses of the cameras, in the order of the rig.
    pub cameras: Vec<CameraPose>,
    /// Fraction of the object's surface that gives no depth.
    pub hole_fraction: quantity::true_value,
}

/// Pose of a frame in another.
#[quantity::checked]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FramePose {
    /// Position in metres.
    pub position_m: quantity::true_value<[f64; 3]>,
    /// Orientation, a unit quaternion x, y, z, w.
    pub orientation_xyzw: quantity::true_value<[f64; 4]>,
}

/// Pose of a camera in W, z forward and y down, and its place in time.
#[quantity::checked]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CameraPose {
    /// The pose.
    #[serde(flatten)]
    pub pose: FramePose,
    /// Time at which the first image of a free-running camera is due, in seconds; none for one that takes an
    /// image at every observation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub phase_s: quantity::true_value<Option<f64>>,
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
