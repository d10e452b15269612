//! Propagation of a flight: gravity, quadratic drag and free rotation.

use std::ops::AddAssign;

use catch_body::{
    Pose, Twist,
    dynamics::gravity,
    free_flight::{
        ballistic::{Law, Motion},
        tumbling::Tumbling,
    },
};
use nalgebra::{Matrix3, Matrix6, Point3, SMatrix, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::{AerodynamicForces, LocalFlight, ProcessNoise};

/// A flight: the state at one instant and the law by which it goes on.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FlightTrajectory {
    /// The instant of the state below, in seconds on the cell's clock: that of the newest pose it rests on.
    pub time_s: f64,
    /// Position of the object's centre of mass Ocm in W, in metres; that of O is
    /// [`pose_at`](Self::pose_at)'s. In files it is `p_WO`.
    #[serde(rename = "p_WO")]
    pub p_WOcm: Point3<f64>,
    /// Velocity of the centre of mass in W, in m/s. In files it is `v_WO`.
    #[serde(rename = "v_WO")]
    pub v_WOcm: Vector3<f64>,
    /// Orientation in W.
    pub R_WO: UnitQuaternion<f64>,
    /// Angular velocity in W, rad/s.
    pub w_WO: Vector3<f64>,
    /// Drag constant k in a = −k·|v|·v, in 1/m.
    pub drag_per_m: f64,
    /// Decay c of its spin in 1/s.
    #[serde(default)]
    pub spin_decay_per_s: f64,
    /// Inertia tensor in O divided by the mass, in m², where it makes the object tumble; `None` where the
    /// angular velocity stays as it is.
    pub inertia_per_kg: Option<Matrix3<f64>>,
    /// Covariance of (p in m, v in m/s, k in 1/m) at `time_s`: rows 0–2, 3–5 and 6, in W.
    pub covariance: SMatrix<f64, 7, 7>,
    /// Covariance of (rotation vector in rad, ω in rad/s) at `time_s`: rows 0–2 and 3–5, in W.
    pub rotation_covariance: Matrix6<f64>,
    /// Error in metres that all poses have in common and no number of them reduces (calibration); part of
    /// every covariance.
    pub systematic_sd_m: f64,
    /// The centre of mass in O, in metres: how far it is from where the reference model has it.
    #[serde(default)]
    pub com_O: Vector3<f64>,
    /// Covariance of (p, v, that) at `time_s`.
    #[serde(default)]
    pub com_covariance: SMatrix<f64, 9, 3>,
    /// Aerodynamic forces besides that drag.
    #[serde(default)]
    pub forces: AerodynamicForces,
    /// Covariance of (p, v, f) with f, the acceleration by these forces, at `time_s`.
    #[serde(default)]
    pub force_covariance: SMatrix<f64, 9, 3>,
    /// Process noise that no model of the flight covers; part of every covariance after `time_s`.
    #[serde(default)]
    pub process_noise: ProcessNoise,
    /// Poses that agree with it.
    pub inliers: usize,
    /// Poses that were looked at.
    pub considered: usize,
    /// Ratio of the poses' errors to those that their information states (1: as stated).
    pub error_scale: f64,
}

/// Longest step of the integration with forces that depend on the orientation: at 25 rad/s a quarter of a
/// radian, and an error of a tenth of a millimetre.
const PUSHED_STEP_S: f64 = 0.01;
/// Most steps, so that absurd times cost no more than wrong answers.
const MAX_STEPS: f64 = 500.0;

/// A flight followed from time to time: a state costs as much as the way to it from the one before.
#[derive(Debug, Clone)]
pub struct FlightPropagator {
    drag_per_m: f64,
    com_O: Vector3<f64>,
    forces: AerodynamicForces,
    moved_s: f64,
    motion: Motion,
    turned_s: f64,
    tumbling: Tumbling,
}

impl FlightPropagator {
    /// Position of the centre of mass at `time_s`, which is cheaper than the rest.
    pub fn position_at(&mut self, time_s: f64) -> Point3<f64> {
        if self.forces.any() {
            return self.pushed_to(time_s);
        }
        self.motion = self.motion.after(time_s - self.moved_s, &Law::with_drag(self.drag_per_m), false);
        self.moved_s = time_s;
        self.motion.p.into()
    }

    /// Propagates with forces that depend on the orientation, by the midpoint rule.
    fn pushed_to(&mut self, time_s: f64) -> Point3<f64> {
        self.tumbling = self.tumbling.after(self.moved_s - self.turned_s, false);
        let steps = ((time_s - self.moved_s).abs() / PUSHED_STEP_S).ceil().min(MAX_STEPS);
        let h = (time_s - self.moved_s) / steps.max(1.0);
        for _ in 0..steps as usize {
            let acceleration = |tumbling: &Tumbling, v: &Vector3<f64>| {
                let forces = self.forces.acceleration_mps2(&tumbling.R_WO, v, &tumbling.w_WO(), tumbling.left);
                gravity() - v * (self.drag_per_m * v.norm()) + forces
            };
            let middle = self.tumbling.after(h / 2.0, false);
            let Motion { p, v, .. } = &mut self.motion;
            let v_middle = *v + acceleration(&self.tumbling, v) * (h / 2.0);
            *p += v_middle * h;
            *v += acceleration(&middle, &v_middle) * h;
            self.tumbling = middle.after(h / 2.0, false);
        }
        (self.moved_s, self.turned_s) = (time_s, time_s);
        self.motion.p.into()
    }

    /// The flight near `time_s`.
    pub fn local_flight_at(&mut self, time_s: f64) -> LocalFlight {
        let p_W = self.position_at(time_s);
        self.tumbling = self.tumbling.after(time_s - self.turned_s, false);
        self.turned_s = time_s;
        let (R_WO, w_WO) = (self.tumbling.R_WO, self.tumbling.w_WO());
        let to_com_W = R_WO * self.com_O;
        LocalFlight {
            time_s,
            X_WO: Pose::from_parts((p_W - to_com_W).into(), R_WO),
            V_WO: Twist { angular: w_WO, linear: self.motion.v - w_WO.cross(&to_com_W) },
            com_O: self.com_O,
            drag_per_m: self.drag_per_m,
            forces_mps2: self.forces.acceleration_mps2(&R_WO, &self.motion.v, &w_WO, self.tumbling.left),
        }
    }
}

impl FlightTrajectory {
    /// Propagator that follows the flight from its own time on, forward or back.
    pub fn propagator(&self) -> FlightPropagator {
        FlightPropagator {
            drag_per_m: self.drag_per_m,
            com_O: self.com_O,
            forces: self.forces,
            moved_s: self.time_s,
            motion: Motion::new(self.p_WOcm.coords, self.v_WOcm),
            turned_s: self.time_s,
            tumbling: self.tumbling(),
        }
    }

    /// Rotation of the object, from the flight's own time on.
    pub(super) fn tumbling(&self) -> Tumbling {
        Tumbling::new(self.R_WO, &self.w_WO, self.inertia_per_kg.as_ref()).decaying(self.spin_decay_per_s)
    }

    /// The flight near `time_s`.
    pub fn local_flight_at(&self, time_s: f64) -> LocalFlight {
        self.propagator().local_flight_at(time_s)
    }

    /// Pose at `time_s`.
    pub fn pose_at(&self, time_s: f64) -> Pose {
        self.local_flight_at(time_s).X_WO
    }

    /// Spatial velocity at `time_s`.
    pub fn twist_at(&self, time_s: f64) -> Twist {
        self.local_flight_at(time_s).V_WO
    }

    /// Covariance of the rotation vector in W some time later, as if the angular velocity stayed as it is.
    fn turn_covariance_after(&self, duration_s: f64) -> Matrix3<f64> {
        let block = |i, j| self.rotation_covariance.fixed_view::<3, 3>(i, j).into_owned();
        block(0, 0) + (block(0, 3) + block(3, 0)) * duration_s + block(3, 3) * (duration_s * duration_s)
    }

    /// Covariance of (position of O, velocity of the centre of mass) in W at `time_s`, m² and m²/s².
    ///
    /// Σ(t) = Φ·Σ₀·Φᵀ, Φ being the derivative of (p, v) at `time_s` with respect to (p, v, k) at the state's
    /// time.
    pub fn covariance_at(&self, time_s: f64) -> Matrix6<f64> {
        let start = Motion::new(self.p_WOcm.coords, self.v_WOcm);
        let motion = start.after(time_s - self.time_s, &Law::with_drag(self.drag_per_m), true);
        let mut transition = SMatrix::<f64, 6, 7>::zeros();
        transition.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        transition.fixed_view_mut::<3, 4>(0, 3).copy_from(&motion.dp);
        transition.fixed_view_mut::<3, 4>(3, 3).copy_from(&motion.dv);
        let mut covariance = transition * self.covariance * transition.transpose();
        if self.forces.any() {
            // The error of the forces continues as a constant acceleration.
            let t = time_s - self.time_s;
            let mut by_force = SMatrix::<f64, 6, 3>::zeros();
            by_force.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(t * t / 2.0);
            by_force.fixed_view_mut::<3, 3>(3, 0).fill_diagonal(t);
            let own = by_force * self.force_covariance.fixed_rows::<3>(6) * by_force.transpose();
            let with = transition.fixed_columns::<6>(0) * self.force_covariance.fixed_rows::<6>(0);
            let crossed = with * by_force.transpose();
            covariance += own + crossed + crossed.transpose();
        }
        if self.com_covariance.iter().any(|it| *it != 0.0) {
            let by_com = -self.pose_at(time_s).rotation.to_rotation_matrix().into_inner();
            let by_turn = (by_com * self.com_O).cross_matrix();
            let own = by_com * self.com_covariance.fixed_rows::<3>(6) * by_com.transpose()
                + by_turn * self.turn_covariance_after(time_s - self.time_s) * by_turn.transpose();
            let crossed =
                transition.fixed_columns::<6>(0) * self.com_covariance.fixed_rows::<6>(0) * by_com.transpose();
            covariance.fixed_columns_mut::<3>(0).add_assign(crossed);
            covariance.fixed_rows_mut::<3>(0).add_assign(crossed.transpose());
            covariance.fixed_view_mut::<3, 3>(0, 0).add_assign(own);
        }
        if self.process_noise.any() {
            covariance += self.process_noise.covariance(time_s - self.time_s);
        }
        for i in 0..3 {
            covariance[(i, i)] += self.systematic_sd_m.powi(2);
        }
        covariance
    }

    /// Standard deviation of the position at `time_s`, the largest over all directions, in metres.
    pub fn position_sd_at(&self, time_s: f64) -> f64 {
        let covariance = self.covariance_at(time_s).fixed_view::<3, 3>(0, 0).into_owned();
        covariance.symmetric_eigenvalues().max().max(0.0).sqrt()
    }
}
