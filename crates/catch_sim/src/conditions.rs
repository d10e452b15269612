//! Conditions that differ from throw to throw besides the throw itself: materials, air, spin, and the robot's
//! own errors.
//!
//! Everything is drawn from a stream of its own, and drawn whether it is switched on or not: what one setting
//! does never shows in another.

use std::f64::consts::TAU;

use catch_body::{Pose, Robot, Twist};
use nalgebra::{Translation3, Unit, UnitQuaternion, Vector3};

use crate::{
    aerodynamics::Aerodynamics,
    config::ArenaConfig,
    object::ThrownObject,
    random_streams::{Draws, Stream},
};

/// The conditions of one throw: a pure function of the scenario, the object, the seed and the index.
#[derive(Debug, Clone, PartialEq)]
pub struct Conditions {
    /// Coulomb friction coefficient of all contacts.
    pub friction: f64,
    /// Coefficient of restitution of all contacts.
    pub restitution: f64,
    /// Drag constant k of a = −k·|v|·v in 1/m, v relative to the air; zero without air.
    pub drag_per_m: f64,
    /// Aerodynamic coefficients besides it.
    pub aerodynamics: Aerodynamics,
    /// Velocity of the air in W.
    pub wind_mps: Vector3<f64>,
    /// Angular velocity in W that the thrower gives besides the throw's own.
    pub spin_radps: Vector3<f64>,
    /// Mass of each link over that in the model.
    pub(crate) link_mass_ratio: [f64; catch_body::MAX_JOINTS],
    /// True pose of the gripper: its frame G in that of the model, M.
    pub(crate) X_MG: Pose,
}

impl Conditions {
    /// Draws the conditions of throw number `index` of `seed`.
    pub fn draw(config: &ArenaConfig, object: &ThrownObject, seed: u64, index: u64) -> Self {
        let draws = |stream| Draws::new(stream, seed, index);
        let around =
            |value: f64, fraction: f64, draws: &mut Draws| value * (1.0 + fraction * draws.between([-1.0, 1.0]));

        let restitution = object.restitution * config.restitution_scale;
        let restitution = around(restitution, config.restitution_spread, &mut draws(Stream::Restitution));
        let drag_per_m = around(object.drag_per_m, config.drag_spread, &mut draws(Stream::Drag));
        let drag_per_m = if config.drag { drag_per_m } else { 0.0 };
        let mut spins = draws(Stream::Spin);
        let spin_radps = spins.direction().into_inner() * (config.max_spin_radps * spins.unit());
        let errors = &config.robot_errors;
        let mut masses = draws(Stream::LinkMasses);
        let mut tools = draws(Stream::ToolMount);
        let offset = tools.direction().into_inner() * errors.tool_position_m;
        let turn = UnitQuaternion::from_axis_angle(&tools.direction(), errors.tool_rotation_deg.to_radians());
        Self {
            friction: draws(Stream::Friction).between(object.friction.unwrap_or(config.friction).bounds()),
            restitution: restitution.min(1.0),
            drag_per_m,
            aerodynamics: Aerodynamics::draw(
                &config.aerodynamics,
                &object.inertia_kgm2,
                &mut draws(Stream::Aerodynamics),
            ),
            wind_mps: config.wind.into(),
            spin_radps,
            link_mass_ratio: std::array::from_fn(|_| around(1.0, errors.link_mass_spread, &mut masses)),
            X_MG: Pose::from_parts(Translation3::from(offset), turn),
        }
    }

    /// The arm as it truly is. `model` comes without the gripper's mass.
    pub fn true_robot(&self, model: &Robot) -> Robot {
        let mut robot = model.clone();
        for (joint, ratio) in robot.joints.iter_mut().zip(self.link_mass_ratio) {
            joint.inertia.mass *= ratio;
            joint.inertia.about_com *= ratio;
        }
        robot.X_LG *= self.X_MG;
        robot
    }

    /// The acceleration by the air of an object of this orientation and spatial velocity, in m/s².
    pub fn air_mps2(&self, R_WO: &UnitQuaternion<f64>, V_WO: &Twist) -> Vector3<f64> {
        let v_AO = V_WO.linear - self.wind_mps;
        let Aerodynamics { drag_deviation_O, magnus, .. } = self.aerodynamics;
        let across = R_WO * (drag_deviation_O * R_WO.inverse_transform_vector(&v_AO));
        let deviation = V_WO.angular.cross(&v_AO) * magnus - across * (self.drag_per_m * v_AO.norm());
        self.drag_mps2(&V_WO.linear) + deviation
    }

    /// The part of it that brakes alike from all sides: a = −k·|v − w|·(v − w).
    pub fn drag_mps2(&self, v_WO: &Vector3<f64>) -> Vector3<f64> {
        let v_AO = v_WO - self.wind_mps;
        -v_AO * (self.drag_per_m * v_AO.norm())
    }
}

impl Draws {
    /// A direction, uniform over the sphere (Archimedes: its height above the equator is uniform).
    pub fn direction(&mut self) -> Unit<Vector3<f64>> {
        let (height, azimuth) = (self.between([-1.0, 1.0]), TAU * self.unit());
        let radius = (1.0 - height * height).max(0.0).sqrt();
        Unit::new_normalize(Vector3::new(radius * libm::cos(azimuth), radius * libm::sin(azimuth), height))
    }

    /// An orientation, uniform over all (Shoemake, Uniform random rotations, Graphics Gems III, 1992).
    pub fn orientation(&mut self) -> UnitQuaternion<f64> {
        let (u, one, two) = (self.unit(), TAU * self.unit(), TAU * self.unit());
        let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
        let [x, y, z, w] = [a * libm::sin(one), a * libm::cos(one), b * libm::sin(two), b * libm::cos(two)];
        UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
    }
}
