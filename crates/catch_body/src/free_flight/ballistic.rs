//! A point mass under gravity and quadratic drag, and how its motion depends on where it begins.

use nalgebra::{Matrix3, SMatrix, Vector3};

use crate::dynamics::gravity;

/// Longest step of the integration. At 10 m/s and a drag constant of 0.2 1/m its error stays below 10 nm over
/// a second.
const STEP_S: f64 = 0.02;
/// Most steps, so that absurd times cost no more than wrong answers.
const MAX_STEPS: f64 = 500.0;

/// The law of motion v̇ = g − k·|v|·v.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Law<const N: usize> {
    /// Drag constant k in 1/m.
    pub drag_per_m: f64,
    /// Gravity g in m/s².
    pub gravity: Vector3<f64>,
    /// How v̇ depends on the parameters of the motion's derivatives, but for the velocity and the drag.
    pub by_others: SMatrix<f64, 3, N>,
}

impl Law<4> {
    /// The law under W's gravity.
    pub fn with_drag(drag_per_m: f64) -> Self {
        Self { drag_per_m, gravity: gravity(), by_others: SMatrix::zeros() }
    }
}

/// Position and velocity, and how they depend on N parameters: the velocity at the start, the drag constant
/// and others of the law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<const N: usize = 4> {
    /// Position.
    pub p: Vector3<f64>,
    /// Velocity.
    pub v: Vector3<f64>,
    /// Derivatives of the position; by the position at the start it is the identity.
    pub dp: SMatrix<f64, 3, N>,
    /// Derivatives of the velocity; by the position at the start they are zero.
    pub dv: SMatrix<f64, 3, N>,
}

impl<const N: usize> Motion<N> {
    /// The motion as it begins.
    pub fn new(p: Vector3<f64>, v: Vector3<f64>) -> Self {
        let mut dv = SMatrix::<f64, 3, N>::zeros();
        dv.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        Self { p, v, dp: SMatrix::zeros(), dv }
    }

    /// The motion `duration_s` later (or earlier, if negative).
    ///
    /// Without drag in closed form; with it by Runge–Kutta of fourth order, the derivatives together with the
    /// state.
    pub fn after(&self, duration_s: f64, law: &Law<N>, with_derivatives: bool) -> Self {
        if law.drag_per_m == 0.0 && !with_derivatives {
            let p = self.p + self.v * duration_s + law.gravity * (0.5 * duration_s * duration_s);
            return Self { p, v: self.v + law.gravity * duration_s, ..*self };
        }
        let steps = (duration_s.abs() / STEP_S).ceil().min(MAX_STEPS);
        let mut motion = *self;
        let h = duration_s / steps.max(1.0);
        for _ in 0..steps as usize {
            if law.drag_per_m == 0.0 {
                motion = motion.after_step_without_drag(h, law);
                continue;
            }
            let k1 = motion.rate(law, with_derivatives);
            let k2 = motion.plus(&k1, h / 2.0).rate(law, with_derivatives);
            let k3 = motion.plus(&k2, h / 2.0).rate(law, with_derivatives);
            let k4 = motion.plus(&k3, h).rate(law, with_derivatives);
            motion = motion.plus(&k1, h / 6.0).plus(&k2, h / 3.0).plus(&k3, h / 3.0).plus(&k4, h / 6.0);
        }
        motion
    }

    /// A step of the parabola, with derivatives: ∂p/∂v = h and, with a(t) = −|v|v, ∂v/∂k = ∫a dt and ∂p/∂k =
    /// ∫(h − t)·a dt, by Simpson's rule.
    fn after_step_without_drag(&self, h: f64, law: &Law<N>) -> Self {
        let v_at = |fraction: f64| self.v + law.gravity * (fraction * h);
        let by_drag = [0.0, 0.5, 1.0].map(|fraction| v_at(fraction) * -v_at(fraction).norm());
        let mut after = *self;
        after.p += self.v * h + law.gravity * (0.5 * h * h);
        after.v = v_at(1.0);
        after.dp += self.dv * h;
        for i in 4..N {
            let (mut position, mut velocity) = (after.dp.column_mut(i), after.dv.column_mut(i));
            position += law.by_others.column(i) * (0.5 * h * h);
            velocity += law.by_others.column(i) * h;
        }
        let mut position = after.dp.column_mut(3);
        position += (by_drag[0] + by_drag[1] * 2.0) * (h * h / 6.0);
        let mut velocity = after.dv.column_mut(3);
        velocity += (by_drag[0] + by_drag[1] * 4.0 + by_drag[2]) * (h / 6.0);
        after
    }

    /// Time derivative: ṗ = v, v̇ = g − k|v|v, and with A = ∂v̇/∂v = −k(|v|·1 + v·vᵀ/|v|):
    /// d/dt ∂p = ∂v, d/dt ∂v = A·∂v + [0 | −|v|v | ∂g].
    fn rate(&self, law: &Law<N>, with_derivatives: bool) -> Self {
        let speed = self.v.norm();
        let acceleration = law.gravity - self.v * (law.drag_per_m * speed);
        if !with_derivatives {
            return Self { p: self.v, v: acceleration, dp: SMatrix::zeros(), dv: SMatrix::zeros() };
        }
        let along = if speed > 1e-9 { self.v * self.v.transpose() / speed } else { Matrix3::zeros() };
        let A = (Matrix3::identity() * speed + along) * -law.drag_per_m;
        let mut ddv = A * self.dv;
        for i in 4..N {
            let mut by_other = ddv.column_mut(i);
            by_other += law.by_others.column(i);
        }
        let mut by_drag = ddv.column_mut(3);
        by_drag -= self.v * speed;
        Self { p: self.v, v: acceleration, dp: self.dv, dv: ddv }
    }

    fn plus(&self, rate: &Self, h: f64) -> Self {
        Self { p: self.p + rate.p * h, v: self.v + rate.v * h, dp: self.dp + rate.dp * h, dv: self.dv + rate.dv * h }
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
        let closed = start().after(0.7, &Law::with_drag(0.0), false);
        let integrated = start().after(0.7, &Law::with_drag(0.0), true);
        assert!((closed.p - integrated.p).norm() < 1e-12 && (closed.v - integrated.v).norm() < 1e-12);
        let back = integrated.after(-0.7, &Law::with_drag(0.0), false);
        assert!((back.p - start().p).norm() < 1e-12);
    }

    #[test]
    fn integration_agrees_with_tiny_steps_and_runs_backwards() {
        let coarse = start().after(0.8, &Law::with_drag(0.2), false);
        let mut fine = start();
        for _ in 0..8000 {
            let rate = fine.rate(&Law::with_drag(0.2), false);
            let middle = fine.plus(&rate, 5e-5).rate(&Law::with_drag(0.2), false);
            fine = fine.plus(&middle, 1e-4);
        }
        assert!((coarse.p - fine.p).norm() < 1e-7, "{}", (coarse.p - fine.p).norm());
        let back = coarse.after(-0.8, &Law::with_drag(0.2), false);
        assert!((back.p - start().p).norm() < 1e-6, "{}", (back.p - start().p).norm());
    }

    #[test]
    fn derivatives_are_those_of_the_motion() {
        let (elapsed, h) = (0.6, 1e-5);
        for (drag, i) in [0.08, 0.0].into_iter().flat_map(|drag| (0..4).map(move |i| (drag, i))) {
            let analytic = start().after(elapsed, &Law::with_drag(drag), true);
            let at = |sign: f64| {
                let mut motion = start();
                if i < 3 {
                    motion.v[i] += sign * h;
                }
                motion.after(elapsed, &Law::with_drag(drag + if i == 3 { sign * h } else { 0.0 }), false)
            };
            let (more, less) = (at(1.0), at(-1.0));
            assert!(((more.p - less.p) / (2.0 * h) - analytic.dp.column(i)).norm() < 1e-6);
            assert!(((more.v - less.v) / (2.0 * h) - analytic.dv.column(i)).norm() < 1e-6);
        }
    }
}
