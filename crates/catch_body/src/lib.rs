//! Bodies: what the catching robot's brain and the arena it acts in both know about physical things.
//!
//! Poses, meshes, clouds with their surfaces, shapes, ray casting, collision distance, symmetries; free
//! flight; a serial arm read from a URDF and a `robot.toml`, its forward and inverse kinematics, Jacobians
//! and inverse dynamics; a parallel gripper and how its fingers close; and small quadratic programs. There is
//! no camera and no throw here.
//!
//! Poses are written in monogram notation: `X_WG` is the pose of frame G in frame W, `p_WO` the position of O
//! in W, `R_WG` a rotation. W is the world (z up), G the gripper, O the object with its origin at the centre
//! of mass, L a link of the arm.
//!
//! Begin with [`Robot`] (an arm from its two files, with [kinematics], [dynamics] and [inverse
//! kinematics](inverse_kinematics)), [`TriangleMesh`] (solids and their mass properties) and [`mod@quantity`]
//! (what every number of a file is checked against):
//!
//! ```
//! use catch_body::TriangleMesh;
//!
//! let ball = TriangleMesh::sphere(0.03, 4);
//! let inertia = ball.mass_properties(0.06);
//! // 2/5·m·r² of a solid ball, but for the facets.
//! assert!(ball.is_closed() && (inertia.about_com[(0, 0)] / (0.4 * 0.06 * 0.03 * 0.03) - 1.0).abs() < 0.01);
//! ```

pub mod clearance;
pub mod distance_field;
pub mod document;
pub mod dynamics;
pub mod free_flight;
pub mod gripper;
pub mod inertia;
pub mod input_error;
pub mod inverse_kinematics;
pub mod kinematics;
pub mod mesh;
pub mod mesh_file;
pub mod neighbours;
pub mod normal_distribution;
pub mod pose;
pub mod quadratic_program;
pub mod quantity;
pub mod ray_cast;
pub mod robot;
pub mod robot_file;
pub mod scanned_surface;
pub mod shape;
pub mod stated;
pub mod statistics;
pub mod symmetry;
mod toml_input;
pub mod urdf;
pub mod velocity_table;
pub mod visual;
pub mod workcell;

pub use gripper::{DriveControl, Gripper};
pub use input_error::InputError;
pub use mesh::TriangleMesh;
pub use pose::{Pose, Twist};
pub use robot::{JointVector, MAX_JOINTS, Robot};
