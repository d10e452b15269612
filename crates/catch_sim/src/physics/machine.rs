//! Arm and fingers: a tree of rigid bodies of fixed size.
//!
//! Forward dynamics solve M(q)·v̇ = τ − h(q, v): the mass matrix by the composite-rigid-body algorithm, the
//! bias forces h by the recursive Newton–Euler algorithm (Featherstone, Rigid Body Dynamics Algorithms,
//! sections 6.2 and 5.3). The factor of M also tells how the tree answers to an impulse.

use catch_body::{
    Gripper, JointVector, MAX_JOINTS, Pose, Robot,
    robot::{Inertia, Joint},
};
use nalgebra::{Cholesky, Const, SMatrix, SVector, Translation3, UnitQuaternion, UnitVector3, Vector3};

use super::spatial::{Spatial, SpatialInertia};

/// Coordinates: the joints of the arm, then the left and the right finger. What the arm does not have stands
/// still behind them.
pub(super) const COORDINATES: usize = MAX_JOINTS + 2;
pub(super) type Coordinates = SVector<f64, COORDINATES>;
type Factor = Cholesky<f64, Const<COORDINATES>>;

/// A body and the joint that moves it: one of the arm, which turns it, or that of a finger, which slides it.
#[derive(Debug, Clone)]
struct Link {
    /// Pose of the joint in the parent, at coordinate zero that of the link.
    X_PL: Pose,
    axis: UnitVector3<f64>,
    inertia: Inertia,
    /// Inertia of the drive, reflected to the coordinate.
    rotor_inertia: f64,
    damping: f64,
}

/// The tree and its state. Body 0 is the base, and the link of joint i is body i + 1.
#[derive(Debug, Clone)]
pub(super) struct Machine {
    links: Vec<Link>,
    pub X_WB: Pose,
    /// The body that carries the gripper, and the pose of G in it.
    pub hand: usize,
    pub X_HG: Pose,
    /// Farthest that a finger opens.
    pub widest_m: f64,
    pub positions: Coordinates,
    pub velocities: Coordinates,
}

/// Quantities of the tree that depend on its positions.
#[derive(Debug, Clone)]
pub(super) struct Posture {
    /// Poses of the bodies, base first.
    pub X_WL: [Pose; COORDINATES + 1],
    /// Motion of a body by its own joint alone, at unit speed.
    motions: [Spatial; COORDINATES],
    inertias: [SpatialInertia; COORDINATES],
    /// Factor of the mass matrix.
    pub factor: Factor,
}

impl Machine {
    /// Machine at rest, with the inner faces of the fingers `finger_m` from the middle. The arm comes without
    /// the gripper's mass.
    pub fn new(robot: &Robot, q: &JointVector, gripper: &Gripper, drive_mass_kg: f64, finger_m: f64) -> Self {
        let of_joint = |joint: &Joint| {
            let Joint { X_PL, axis, inertia, rotor_inertia, damping, .. } = *joint;
            Link { X_PL, axis, inertia, rotor_inertia, damping }
        };
        let mut links: Vec<Link> = robot.joints.iter().map(of_joint).collect();
        if let Some(last) = links.last_mut() {
            last.inertia = last.inertia.joined(&gripper.body_inertia().transformed(&robot.X_LG));
        }
        // Fingers slide along the x axis of G, the left one towards −x. Their frames lie on G when their
        // inner faces meet in the middle.
        for (inertia, axis) in gripper.finger_inertias(0.0).into_iter().zip([-Vector3::x_axis(), Vector3::x_axis()]) {
            links.push(Link { X_PL: robot.X_LG, axis, inertia, rotor_inertia: drive_mass_kg, damping: 0.0 });
        }
        let mut machine = Self {
            links,
            X_WB: robot.X_WB,
            hand: robot.dof(),
            X_HG: robot.X_LG,
            widest_m: gripper.max_width_m / 2.0,
            positions: Coordinates::zeros(),
            velocities: Coordinates::zeros(),
        };
        machine.positions = machine.joined(q, [finger_m; 2]);
        machine
    }

    /// Positions or velocities of arm and fingers apart.
    pub fn apart(&self, values: &Coordinates) -> (JointVector, [f64; 2]) {
        let arm = JointVector::from_fn(|i, _| if i < self.hand { values[i] } else { 0.0 });
        (arm, [values[self.hand], values[self.hand + 1]])
    }

    /// The reverse of [`Self::apart`].
    pub fn joined(&self, arm: &JointVector, fingers: [f64; 2]) -> Coordinates {
        let mut values = Coordinates::zeros();
        values.rows_mut(0, self.hand).copy_from(&arm.rows(0, self.hand));
        (values[self.hand], values[self.hand + 1]) = (fingers[0], fingers[1]);
        values
    }

    /// Kinematics and mass matrix; `None` if the matrix is singular or not finite.
    ///
    /// Damping acts by the mean of the velocities before and after a step of `step_s`, which adds to the mass
    /// matrix (Crank–Nicolson): an explicit one would be unstable for light links.
    pub fn posture(&self, positions: &Coordinates, step_s: f64) -> Option<Posture> {
        let mut X_WL = [self.X_WB; COORDINATES + 1];
        let mut motions = [Spatial::default(); COORDINATES];
        let mut inertias = [SpatialInertia::default(); COORDINATES];
        for (i, link) in self.links.iter().enumerate() {
            let mut pose = X_WL[self.parent(i)] * link.X_PL;
            let axis = pose.rotation * link.axis.into_inner();
            if i < self.hand {
                pose.rotation *= UnitQuaternion::from_axis_angle(&link.axis, positions[i]);
                motions[i] = Spatial::about(axis, &pose.translation.vector);
            } else {
                pose *= Translation3::from(link.axis.into_inner() * positions[i]);
                motions[i] = Spatial { angular: Vector3::zeros(), linear: axis };
            }
            X_WL[i + 1] = pose;
            inertias[i] = SpatialInertia::of(&link.inertia, &pose);
        }
        let mut masses = self.mass_matrix(&motions, inertias);
        for (i, link) in self.links.iter().enumerate() {
            masses[(i, i)] += link.damping * step_s / 2.0;
        }
        let factor = masses.cholesky()?;
        Some(Posture { X_WL, motions, inertias, factor })
    }

    fn mass_matrix(
        &self,
        motions: &[Spatial; COORDINATES],
        mut composites: [SpatialInertia; COORDINATES],
    ) -> SMatrix<f64, COORDINATES, COORDINATES> {
        let mut matrix = SMatrix::identity();
        for (i, link) in self.links.iter().enumerate().rev() {
            let composite = composites[i];
            if let Some(parent) = self.parent(i).checked_sub(1) {
                composites[parent] += composite;
            }
            let momentum = composite.momentum(&motions[i]);
            matrix[(i, i)] = motions[i].dot(&momentum) + link.rotor_inertia;
            for j in self.ancestors(i) {
                matrix[(i, j)] = motions[j].dot(&momentum);
                matrix[(j, i)] = matrix[(i, j)];
            }
        }
        matrix
    }

    /// The body that carries a joint: that before it in the arm, or the hand.
    fn parent(&self, joint: usize) -> usize {
        joint.min(self.hand)
    }

    /// The joints between a joint and the base.
    fn ancestors(&self, joint: usize) -> impl Iterator<Item = usize> + use<> {
        (0..self.parent(joint)).rev()
    }

    /// Motions of the bodies, base first.
    pub fn motions(&self, posture: &Posture, velocities: &Coordinates) -> [Spatial; COORDINATES + 1] {
        let mut motions = [Spatial::default(); COORDINATES + 1];
        for i in 0..self.links.len() {
            motions[i + 1] = motions[self.parent(i)] + posture.motions[i] * velocities[i];
        }
        motions
    }

    /// Forces along the coordinates that keep the velocities as they are, without damping: gravity, Coriolis
    /// and centrifugal forces.
    pub fn bias_forces(&self, posture: &Posture, velocities: &Coordinates, gravity: &Vector3<f64>) -> Coordinates {
        let moving = self.motions(posture, velocities);
        let mut accelerations = [Spatial { angular: Vector3::zeros(), linear: -gravity }; COORDINATES + 1];
        let mut needed = [Spatial::default(); COORDINATES];
        for i in 0..self.links.len() {
            let by_joint = posture.motions[i] * velocities[i];
            accelerations[i + 1] = accelerations[self.parent(i)] + moving[i + 1].cross_motion(&by_joint);
            let momentum = posture.inertias[i].momentum(&moving[i + 1]);
            needed[i] = posture.inertias[i].momentum(&accelerations[i + 1]) + moving[i + 1].cross_force(&momentum);
        }
        let mut bias = Coordinates::zeros();
        for i in (0..self.links.len()).rev() {
            bias[i] = posture.motions[i].dot(&needed[i]);
            if let Some(parent) = self.parent(i).checked_sub(1) {
                needed[parent] = needed[parent] + needed[i];
            }
        }
        bias
    }

    /// Forces of damping.
    pub fn damping(&self, velocities: &Coordinates) -> Coordinates {
        Coordinates::from_fn(|i, _| self.links.get(i).map_or(0.0, |link| link.damping * velocities[i]))
    }

    /// The stops that fingers would pass in a step: of each finger the closed one, and the open one.
    pub fn stops(&self, acceleration: &Coordinates, step_s: f64) -> [Option<Stop>; 4] {
        std::array::from_fn(|i| {
            let coordinate = self.hand + i / 2;
            let position_m = self.positions[coordinate];
            let moved_m = (self.velocities[coordinate] + acceleration[coordinate] * step_s) * step_s;
            let (free, gap_m) = [(1.0, position_m), (-1.0, self.widest_m - position_m)][i % 2];
            (gap_m + free * moved_m < 0.0).then_some(Stop { coordinate, free, gap_m })
        })
    }

    /// Velocity of a body along a direction at a point, per velocity of each coordinate: a row of the
    /// Jacobian. Body 0 is the base.
    pub fn row(&self, posture: &Posture, body: usize, direction: Vector3<f64>, point: &Vector3<f64>) -> Coordinates {
        let mut row = Coordinates::zeros();
        let force = Spatial::force_at(direction, point);
        if let Some(joint) = body.checked_sub(1) {
            for i in std::iter::once(joint).chain(self.ancestors(joint)) {
                row[i] = posture.motions[i].dot(&force);
            }
        }
        row
    }
}

/// The stop of a finger.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stop {
    pub coordinate: usize,
    /// The direction in which it is free, and the way to the stop.
    pub free: f64,
    pub gap_m: f64,
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3, Quaternion};

    use super::*;

    #[derive(serde::Deserialize)]
    struct Golden {
        links: Vec<GoldenLink>,
        states: Vec<State>,
    }

    #[derive(serde::Deserialize)]
    struct GoldenLink {
        q_xyzw: [f64; 4],
        p_m: [f64; 3],
        axis: [f64; 3],
        mass_kg: f64,
        com_m: [f64; 3],
        about_com_kgm2: [f64; 9],
        rotor_inertia: f64,
    }

    #[derive(serde::Deserialize)]
    struct State {
        q: [f64; COORDINATES],
        v: [f64; COORDINATES],
        tau: [f64; COORDINATES],
        a: [f64; COORDINATES],
    }

    fn machine(golden: &Golden) -> Machine {
        let link = |it: &GoldenLink| Link {
            X_PL: Pose::from_parts(it.p_m.into(), UnitQuaternion::new_normalize(Quaternion::from(it.q_xyzw))),
            axis: UnitVector3::new_normalize(it.axis.into()),
            inertia: Inertia {
                mass: it.mass_kg,
                com: Point3::from(it.com_m),
                about_com: Matrix3::from_column_slice(&it.about_com_kgm2),
            },
            rotor_inertia: it.rotor_inertia,
            damping: 0.0,
        };
        Machine {
            links: golden.links.iter().map(link).collect(),
            X_WB: Pose::identity(),
            hand: MAX_JOINTS,
            X_HG: Pose::identity(),
            widest_m: 0.1,
            positions: Coordinates::zeros(),
            velocities: Coordinates::zeros(),
        }
    }

    /// `tests/golden/README.md` says how the numbers were made.
    #[test]
    fn forward_dynamics_are_those_of_pinocchio() {
        let golden: Vec<Golden> =
            serde_json::from_str(include_str!("../../tests/golden/forward_dynamics.json")).unwrap();
        let mut worst = 0.0f64;
        for golden in &golden {
            let machine = machine(golden);
            for State { q, v, tau, a } in &golden.states {
                let posture = machine.posture(&Coordinates::from(*q), 0.0).unwrap();
                let bias = machine.bias_forces(&posture, &Coordinates::from(*v), &Vector3::new(0.0, 0.0, -9.81));
                let ours = posture.factor.solve(&(Coordinates::from(*tau) - bias));
                let theirs = Coordinates::from(*a);
                worst = worst.max((ours - theirs).norm() / theirs.norm());
            }
        }
        assert!(golden.len() == 12 && worst < 1e-9, "{worst}");
    }

    /// The rate of a row's velocity by finite differences of positions.
    #[test]
    fn rows_are_derivatives_of_points() {
        let golden: Vec<Golden> =
            serde_json::from_str(include_str!("../../tests/golden/forward_dynamics.json")).unwrap();
        let machine = machine(&golden[0]);
        let q = Coordinates::from(golden[0].states[0].q);
        let posture = machine.posture(&q, 0.0).unwrap();
        let (local, direction) = (Point3::new(0.1, -0.2, 0.3), Vector3::new(0.3, 0.5, -0.8));
        for body in 1..=COORDINATES {
            let at = |q: &Coordinates| machine.posture(q, 0.0).unwrap().X_WL[body] * local;
            let row = machine.row(&posture, body, direction, &at(&q).coords);
            for i in 0..COORDINATES {
                let step = Coordinates::ith(i, 1e-6);
                let rate = (at(&(q + step)) - at(&(q - step))).dot(&direction) / 2e-6;
                assert!((rate - row[i]).abs() < 1e-8, "body {body}, coordinate {i}: {rate} and {}", row[i]);
            }
        }
    }
}
