//! A parallel gripper with two fingers.
//!
//! Frame G: the fingers close along x, y is the approach, z is across both. The finger called left is
//! the one at negative x. `width` is the distance between the inner faces.

mod closing;

use nalgebra::{Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;

use crate::{
    InputError, TriangleMesh,
    inertia::Inertia,
    pose::Pose,
    quantity,
    shape::Cuboid,
    visual::{ReadMesh, Visual},
};

pub use closing::{Closing, Fingers};

/// Geometry, masses and limits of a parallel gripper, as its file gives them.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Gripper {
    /// Name.
    pub name: String,
    /// Mass of the housing without fingers, in kg.
    pub body_mass_kg: quantity::part_mass_kg,
    /// Extents of the housing, a box around the origin of G.
    pub body_size_m: quantity::size_m<[f64; 3]>,
    /// Mass of one finger, in kg.
    pub finger_mass_kg: quantity::part_mass_kg,
    /// Extents of one finger.
    pub finger_size_m: quantity::size_m<[f64; 3]>,
    /// Centre of the fingers along y.
    pub finger_centre_y_m: quantity::offset_m,
    /// Position along y at which an object's middle should be when the fingers close.
    pub grasp_centre_y_m: quantity::size_m,
    /// Widest opening.
    pub max_width_m: quantity::size_m,
    /// Highest force of one finger.
    pub max_force_n: quantity::force_n,
    /// Highest speed of the fingers relative to each other.
    pub max_speed_mps: quantity::drive_speed_mps,
    /// Highest rate at which that speed changes.
    pub max_acceleration_mps2: quantity::drive_acceleration_mps2,
    /// Drive of the fingers: its commands, latency and rate. By default: width, speed and force, 30 ms, 140
    /// Hz.
    #[serde(default)]
    pub drive: Drive,
    /// Parts of the gripper in the paper's simulator.
    pub published: Option<PublishedParts>,
    /// Surfaces as cameras see them; housing and fingers are seen as boxes without.
    pub visuals: Option<GripperVisuals>,
    /// True if the gripper is simulated with its published parts.
    #[serde(skip)]
    pub is_published: bool,
}

/// A gripper's parts in the paper's simulator.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct PublishedParts {
    /// Moments of inertia of the housing about its centre, along the axes of G.
    pub body_inertia_kgm2: quantity::moment_kgm2<[f64; 3]>,
    /// Moments of inertia of one finger about its centre, along the axes of G.
    pub finger_inertia_kgm2: quantity::moment_kgm2<[f64; 3]>,
    /// Distance of the fingers' boxes behind x = ±width/2.
    pub finger_recess_m: quantity::offset_m,
    /// Centres of the balls with which a finger touches, from where its inner face would be at x = ±width/2
    /// (x outward), and from the fingers' centre along y and z.
    pub tips_m: quantity::offset_m<Vec<[f64; 3]>>,
    /// Radius of the balls with which a finger touches.
    pub tip_radius_m: quantity::size_m,
}

/// Surfaces of a gripper as cameras see them.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GripperVisuals {
    /// The housing, in G.
    pub housing: Visual,
    /// The right finger, at positive x, around the centre of its box along the axes of G. The left finger is
    /// the same one rotated by half a turn about y.
    pub finger: Visual,
}

/// Contact geometry of a finger: a box, and balls with their radius.
pub type FingerContact = (Cuboid, Vec<(Point3<f64>, f64)>);

/// The drive of a gripper behind its command interface.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct Drive {
    /// Quantities of a command that the fingers obey.
    pub control: DriveControl,
    /// Time from a command until the fingers begin to move, in seconds.
    pub latency_s: quantity::latency_s,
    /// Rate of the cycle in which the drive takes commands and refreshes its state.
    pub state_rate_hz: quantity::rate_hz,
}

impl Default for Drive {
    /// Drive of a Schunk WSG-50: the rate is the data sheet's; no latency is published, 30 ms is plausible
    /// over a network.
    fn default() -> Self {
        Self { control: DriveControl::SpeedAndForce, latency_s: 0.03, state_rate_hz: 140.0 }
    }
}

/// Quantities of a command that a gripper's fingers obey.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DriveControl {
    /// Width, speed and force.
    SpeedAndForce,
    /// The width alone: always at full speed, with all the force.
    Position,
    /// Open or closed: a width above half of the widest opens the fingers as far as they go, any other closes
    /// them.
    TwoState,
}

impl Gripper {
    /// Reads a gripper's TOML file; `file` names it in errors.
    pub fn from_toml(file: &str, text: &str) -> Result<Self, InputError> {
        let gripper: Self = InputError::parse_toml(file, text)?;
        if gripper.finger_centre_y_m <= gripper.palm_y_m() - gripper.finger_size_m[1] / 2.0 {
            let expected = "fingers that reach beyond the housing along y";
            return Err(InputError::new(file, "finger_centre_y_m", gripper.finger_centre_y_m, expected));
        }
        if let Some(GripperVisuals { housing, finger }) = &gripper.visuals {
            housing.check(file, "visuals.housing")?;
            finger.check(file, "visuals.finger")?;
        }
        Ok(gripper)
    }

    /// Reads the meshes of the visual shapes.
    ///
    /// # Errors
    /// The first fault of one of them.
    pub fn with_meshes(mut self, read: &ReadMesh) -> Result<Self, InputError> {
        if let Some(GripperVisuals { housing, finger }) = &mut self.visuals {
            housing.read(read)?;
            finger.read(read)?;
        }
        Ok(self)
    }

    /// Surfaces of the housing, in G, and of a finger around its own centre, as cameras see them.
    pub fn surfaces(&self) -> [TriangleMesh; 2] {
        let finger = Cuboid { centre: Point3::origin(), size: Vector3::from(self.finger_size_m) };
        let seen = self.visuals.as_ref().map(|it| [it.housing.mesh(), it.finger.mesh()]);
        let [housing_seen, finger_seen] = seen.unwrap_or_default();
        let or_box = |seen: Option<&TriangleMesh>, of: &Cuboid| seen.cloned().unwrap_or(TriangleMesh::cuboid(of));
        [or_box(housing_seen, &self.body()), or_box(finger_seen, &finger)]
    }

    /// Poses in G of the left and the right finger's surface at an opening of `width_m`.
    pub fn finger_poses(&self, width_m: f64) -> [Pose; 2] {
        let [left, right] = self.fingers(width_m).map(|it| Pose::from(Translation3::from(it.centre.coords)));
        let is_mirrored = self.visuals.is_some();
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI);
        [if is_mirrored { left * half_turn } else { left }, right]
    }

    /// The width to which the fingers go when `width_m` is commanded.
    pub fn driven_width_m(&self, width_m: f64) -> f64 {
        match self.drive.control {
            DriveControl::SpeedAndForce | DriveControl::Position => width_m.clamp(0.0, self.max_width_m),
            DriveControl::TwoState if width_m > self.max_width_m / 2.0 => self.max_width_m,
            DriveControl::TwoState => 0.0,
        }
    }

    /// The palm: where the housing ends along y.
    pub fn palm_y_m(&self) -> f64 {
        self.body_size_m[1] / 2.0
    }

    /// Position of the fingertips along y, in metres.
    pub fn fingertip_y_m(&self) -> f64 {
        self.finger_centre_y_m + self.finger_size_m[1] / 2.0
    }

    /// The grasp centre in G.
    pub fn grasp_centre(&self) -> Point3<f64> {
        Point3::new(0.0, self.grasp_centre_y_m, 0.0)
    }

    /// The housing as a box in G.
    pub fn body(&self) -> Cuboid {
        Cuboid { centre: Point3::origin(), size: Vector3::from(self.body_size_m) }
    }

    /// The left (negative x) and the right finger as boxes in G at an opening of `width_m`.
    pub fn fingers(&self, width_m: f64) -> [Cuboid; 2] {
        [-1.0, 1.0].map(|side| {
            let x = side * (width_m + self.finger_size_m[0]) / 2.0;
            Cuboid { centre: Point3::new(x, self.finger_centre_y_m, 0.0), size: Vector3::from(self.finger_size_m) }
        })
    }

    fn as_simulated(&self) -> Option<&PublishedParts> {
        self.published.as_ref().filter(|_| self.is_published)
    }

    /// Contact geometry of the left and the right finger in G at an opening of `width_m`: a box, and balls
    /// with their radius.
    pub fn finger_contacts(&self, width_m: f64) -> [FingerContact; 2] {
        let Some(parts) = self.as_simulated() else { return self.fingers(width_m).map(|finger| (finger, Vec::new())) };
        let [left, right] = self.fingers(width_m + 2.0 * parts.finger_recess_m);
        [(-1.0, left), (1.0, right)].map(|(side, finger)| {
            let ball = |[x, y, z]: &[f64; 3]| {
                (Point3::new(side * (width_m / 2.0 + x), self.finger_centre_y_m + y, *z), parts.tip_radius_m)
            };
            (finger, parts.tips_m.iter().map(ball).collect())
        })
    }

    /// Mass properties of the housing in G.
    pub fn body_inertia(&self) -> Inertia {
        part_inertia(self.body_mass_kg, &self.body(), self.as_simulated().map(|it| it.body_inertia_kgm2))
    }

    /// Mass properties in G of the left and the right finger at an opening of `width_m`.
    pub fn finger_inertias(&self, width_m: f64) -> [Inertia; 2] {
        let moments = self.as_simulated().map(|it| it.finger_inertia_kgm2);
        self.finger_contacts(width_m).map(|(finger, _)| part_inertia(self.finger_mass_kg, &finger, moments))
    }

    /// Mass properties of housing and fingers in G at an opening of `width_m`.
    pub fn inertia(&self, width_m: f64) -> Inertia {
        self.finger_inertias(width_m).iter().fold(self.body_inertia(), |all, finger| all.joined(finger))
    }
}

/// Mass properties of a part: a box, but for the moments of inertia that it has otherwise.
fn part_inertia(mass_kg: f64, part: &Cuboid, moments_kgm2: Option<[f64; 3]>) -> Inertia {
    let of_box = Inertia::of_box(mass_kg, &part.size, part.centre);
    moments_kgm2.map_or(of_box, |moments| {
        let about_com = Matrix3::from_diagonal(&Vector3::from(moments));
        Inertia { about_com, ..of_box }
    })
}
