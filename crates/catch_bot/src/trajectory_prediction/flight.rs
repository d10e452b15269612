//! Propagation of a flight: gravity, quadratic drag and free rotation.

use catch_body::{Pose, Twist, dynamics::gravity};
use nalgebra::{Matrix3, Matrix6, Point3, SMatrix, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::{AerodynamicForces, LocalFlight, ProcessNoise, tumbling::Tumbling};

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

/// Longest step of the integration. At 10 m/s and a drag constant of 0.2 1/m its error stays below 10 nm over
/// a second.
const STEP_S: f64 = 0.02;
/// Longest step of the integration with forces that depend on the orientation: at 25 rad/s a quarter of a
/// radian, and an error of a tenth of a millimetre.
const PUSHED_STEP_S: f64 = 0.01;
/// Most steps, so that absurd times cost no more than wrong answers.
const MAX_STEPS: f64 = 500.0;

/// Position and velocity, and how they depend on the velocity and drag constant at the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion {
    pub p: Vector3<f64>,
    pub v: Vector3<f64>,
    /// ∂p/∂(v₀, k) and ∂v/∂(v₀, k); ∂p/∂p₀ is the identity and ∂v/∂p₀ zero.
    pub dp: SMatrix<f64, 3, 4>,
    pub dv: SMatrix<f64, 3, 4>,
}

impl Motion {
    pub fn new(p: Vector3<f64>, v: Vector3<f64>) -> Self {
        let mut dv = SMatrix::<f64, 3, 4>::zeros();
        dv.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        Self { p, v, dp: SMatrix::zeros(), dv }
    }

    /// The motion `duration_s` later (or earlier, if negative) under a = g − k·|v|·v.
    ///
    /// Without drag in closed form; with it by Runge–Kutta of fourth order, the derivatives together with the
    /// state.
    pub fn after(&self, duration_s: f64, drag_per_m: f64, with_derivatives: bool) -> Self {
        if drag_per_m == 0.0 && !with_derivatives {
            let p = self.p + self.v * duration_s + gravity() * (0.5 * duration_s * duration_s);
            return Self { p, v: self.v + gravity() * duration_s, ..*self };
        }
        let steps = (duration_s.abs() / STEP_S).ceil().min(MAX_STEPS);
        let mut motion = *self;
        let h = duration_s / steps.max(1.0);
        for _ in 0..steps as usize {
            if drag_per_m == 0.0 {
                motion = motion.after_step_without_drag(h);
                continue;
            }
            let k1 = motion.rate(drag_per_m, with_derivatives);
            let k2 = motion.plus(&k1, h / 2.0).rate(drag_per_m, with_derivatives);
            let k3 = motion.plus(&k2, h / 2.0).rate(drag_per_m, with_derivatives);
            let k4 = motion.plus(&k3, h).rate(drag_per_m, with_derivatives);
            motion = motion.plus(&k1, h / 6.0).plus(&k2, h / 3.0).plus(&k3, h / 3.0).plus(&k4, h / 6.0);
        }
        motion
    }

    /// A step of the parabola, with derivatives: ∂p/∂v = h and, with a(t) = −|v|v, ∂v/∂k = ∫a dt and ∂p/∂k =
    /// ∫(h − t)·a dt, by Simpson's rule.
    fn after_step_without_drag(&self, h: f64) -> Self {
        let v_at = |fraction: f64| self.v + gravity() * (fraction * h);
        let by_drag = [0.0, 0.5, 1.0].map(|fraction| v_at(fraction) * -v_at(fraction).norm());
        let mut after = *self;
        after.p += self.v * h + gravity() * (0.5 * h * h);
        after.v = v_at(1.0);
        after.dp += self.dv * h;
        let mut position = after.dp.column_mut(3);
        position += (by_drag[0] + by_drag[1] * 2.0) * (h * h / 6.0);
        let mut velocity = after.dv.column_mut(3);
        velocity += (by_drag[0] + by_drag[1] * 4.0 + by_drag[2]) * (h / 6.0);
        after
    }

    /// Time derivative: ṗ = v, v̇ = g − k|v|v, and with A = ∂v̇/∂v = −k(|v|·1 + v·vᵀ/|v|):
    /// d/dt ∂p = ∂v, d/dt ∂v = A·∂v + [0 | −|v|v].
    fn rate(&self, drag_per_m: f64, with_derivatives: bool) -> Self {
        let speed = self.v.norm();
        let acceleration = gravity() - self.v * (drag_per_m * speed);
        if !with_derivatives {
            return Self { p: self.v, v: acceleration, dp: SMatrix::zeros(), dv: SMatrix::zeros() };
        }
        let along = if speed > 1e-9 { self.v * self.v.transpose() / speed } else { Matrix3::zeros() };
        let A = (Matrix3::identity() * speed + along) * -drag_per_m;
        let mut ddv = A * self.dv;
        let mut by_drag = ddv.column_mut(3);
        by_drag -= self.v * speed;
        Self { p: self.v, v: acceleration, dp: self.dv, dv: ddv }
    }

    fn plus(&self, rate: &Self, h: f64) -> Self {
        Self { p: self.p + rate.p * h, v: self.v + rate.v * h, dp: self.dp + rate.dp * h, dv: self.dv + rate.dv * h }
    }
}

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
        self.motion = self.motion.after(time_s - self.moved_s, self.drag_per_m, false);
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
        let motion = start.after(time_s - self.time_s, self.drag_per_m, true);
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
            let mut of_position = covariance.fixed_columns_mut::<3>(0);
            of_position += crossed;
            let mut of_position = covariance.fixed_rows_mut::<3>(0);
            of_position += crossed.transpose();
            let mut of_position = covariance.fixed_view_mut::<3, 3>(0, 0);
            of_position += own;
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

#[cfg(test)]
mod tests {
    use super::*;

    fn start() -> Motion {
        Motion::new(Vector3::new(2.6, 2.6, 0.5), Vector3::new(-2.9, -4.0, 3.6))
    }

    #[test]
    fn drag_free_motion_is_a_parabola_both_ways() {
        let closed = start().after(0.7, 0.0, false);
        let integrated = start().after(0.7, 0.0, true);
        assert!((closed.p - integrated.p).norm() < 1e-12 && (closed.v - integrated.v).norm() < 1e-12);
        let back = integrated.after(-0.7, 0.0, false);
        assert!((back.p - start().p).norm() < 1e-12);
    }

    #[test]
    fn integration_agrees_with_tiny_steps_and_runs_backwards() {
        let coarse = start().after(0.8, 0.2, false);
        let mut fine = start();
        for _ in 0..8000 {
            let rate = fine.rate(0.2, false);
            let middle = fine.plus(&rate, 5e-5).rate(0.2, false);
            fine = fine.plus(&middle, 1e-4);
        }
        assert!((coarse.p - fine.p).norm() < 1e-7, "{}", (coarse.p - fine.p).norm());
        let back = coarse.after(-0.8, 0.2, false);
        assert!((back.p - start().p).norm() < 1e-6, "{}", (back.p - start().p).norm());
    }

    #[test]
    fn derivatives_are_those_of_the_motion() {
        let (elapsed, h) = (0.6, 1e-5);
        for (drag, i) in [0.08, 0.0].into_iter().flat_map(|drag| (0..4).map(move |i| (drag, i))) {
            let analytic = start().after(elapsed, drag, true);
            let at = |sign: f64| {
                let mut motion = start();
                if i < 3 {
                    motion.v[i] += sign * h;
                }
                motion.after(elapsed, drag + if i == 3 { sign * h } else { 0.0 }, false)
            };
            let (more, less) = (at(1.0), at(-1.0));
            assert!(((more.p - less.p) / (2.0 * h) - analytic.dp.column(i)).norm() < 1e-6);
            assert!(((more.v - less.v) / (2.0 * h) - analytic.dv.column(i)).norm() < 1e-6);
        }
    }
}
