//! Free rotation: what an object's orientation does in flight.
//!
//! Nothing turns a flying object but its own momentum (drag acts at the centre of mass): L = J_W·ω stays,
//! with J_W = R·J·Rᵀ, so ω = R·J⁻¹·Rᵀ·L changes as the object turns (Euler's equations).
//!
//! Where the air lets the spin decay, L̇ = −c·L, the object goes through the same orientations more and more
//! slowly: R(t) is the free rotation at τ(t) = (1 − e^(−c·t))/c.

use nalgebra::{Matrix3, Quaternion, SMatrix, UnitQuaternion, Vector3};

use crate::pose::left_jacobian;

/// Orientation of a freely rotating object, and how it depends on the orientation and the angular momentum at
/// the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tumbling {
    /// Orientation in W.
    pub R_WO: UnitQuaternion<f64>,
    /// Angular momentum per mass in W.
    pub momentum: Vector3<f64>,
    inertia: Matrix3<f64>,
    inverse: Matrix3<f64>,
    /// True if ω stays constant.
    steady: bool,
    /// Decay c of the momentum in 1/s, and the time since the start.
    decay_per_s: f64,
    elapsed_s: f64,
    /// What is left of the momentum by now.
    pub left: f64,
    /// ∂θ/∂(θ₀, L), rotation vectors in W.
    by_start: SMatrix<f64, 3, 6>,
}

/// Largest turn per step; the error of a step is then below 10⁻⁵ rad.
const STEP_RAD: f64 = 0.1;
/// Most steps, so that absurd spins cost no more than wrong answers.
const MAX_STEPS: usize = 1000;

impl Tumbling {
    /// The state with orientation `R_WO` and angular velocity `w_WO`. Without an inertia tensor ω stays as it
    /// is.
    pub fn new(R_WO: UnitQuaternion<f64>, w_WO: &Vector3<f64>, inertia_per_kg: Option<&Matrix3<f64>>) -> Self {
        // Only ratios matter: scaled to a trace of three, so that momentum is of the size of ω.
        let scaled = inertia_per_kg.map(|inertia| inertia * (3.0 / inertia.trace()));
        let pair = scaled.and_then(|inertia| Some((inertia, inertia.try_inverse()?)));
        let (inertia, inverse) = pair.unwrap_or((Matrix3::identity(), Matrix3::identity()));
        let momentum = R_WO * (inertia * (R_WO.inverse() * w_WO));
        let mut by_start = SMatrix::<f64, 3, 6>::zeros();
        by_start.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        let steady = inertia_per_kg.is_none();
        Self { R_WO, momentum, inertia, inverse, steady, decay_per_s: 0.0, elapsed_s: 0.0, left: 1.0, by_start }
    }

    /// Sets the decay of the momentum.
    pub fn decaying(self, decay_per_s: f64) -> Self {
        Self { decay_per_s, ..self }
    }

    /// Angular velocity in W.
    pub fn w_WO(&self) -> Vector3<f64> {
        self.rate(&self.R_WO)
    }

    fn rate(&self, R_WO: &UnitQuaternion<f64>) -> Vector3<f64> {
        R_WO * (self.inverse * (R_WO.inverse() * self.momentum))
    }

    /// J_W⁻¹ = R·J⁻¹·Rᵀ.
    fn mobility(&self, R_WO: &UnitQuaternion<f64>) -> Matrix3<f64> {
        let R = R_WO.to_rotation_matrix();
        R.matrix() * self.inverse * R.matrix().transpose()
    }

    /// The state `duration_s` later (or earlier, if negative), by Runge–Kutta of fourth order on q̇ = ½ω·q.
    ///
    /// A small turn δθ of the start and a change δL of the momentum obey δθ̇ = ω×δθ + δω with
    /// δω = δθ×ω − J_W⁻¹(δθ×L) + J_W⁻¹δL, that is δθ̇ = J_W⁻¹·(\[L\]ₓ·δθ + δL).
    pub fn after(&self, duration_s: f64, with_derivatives: bool) -> Self {
        if self.decay_per_s == 0.0 {
            return Self { elapsed_s: self.elapsed_s + duration_s, ..self.after_free(duration_s, with_derivatives) };
        }
        let lost = libm::expm1(-self.decay_per_s * duration_s);
        let mut state = self.after_free(-lost / self.decay_per_s, with_derivatives);
        state.elapsed_s += duration_s;
        state.left *= 1.0 + lost;
        state.momentum *= 1.0 + lost;
        state
    }

    /// ∂θ/∂c, c being the decay and all states since the start those of the same one: ω of the free rotation
    /// times ∂τ/∂c.
    pub fn by_decay(&self) -> Vector3<f64> {
        let (c, t) = (self.decay_per_s, self.elapsed_s);
        let by =
            if (c * t).abs() < 1e-4 { -t * t / 2.0 } else { (t * libm::exp(-c * t) + libm::expm1(-c * t) / c) / c };
        self.w_WO() * (by / self.left)
    }

    /// The state after a free rotation.
    fn after_free(&self, duration_s: f64, with_derivatives: bool) -> Self {
        if self.steady {
            return self.after_turning(duration_s, with_derivatives);
        }
        let mut state = *self;
        let mut left_s = duration_s;
        for _ in 0..MAX_STEPS {
            let q = state.R_WO.into_inner();
            let slope = |q: &Quaternion<f64>| {
                let w = self.rate(&UnitQuaternion::new_unchecked(*q));
                Quaternion::from_imag(w) * q * 0.5
            };
            let k1 = slope(&q);
            // Even steps of what is left: |q̇| is half of the rate.
            let steps = (left_s.abs() * 2.0 * k1.norm() / STEP_RAD).ceil().max(1.0);
            let h = left_s / steps;
            let at_middle = (q + k1 * (h / 2.0)).normalize();
            let k2 = slope(&at_middle);
            let k3 = slope(&(q + k2 * (h / 2.0)).normalize());
            let k4 = slope(&(q + k3 * h).normalize());
            let end = UnitQuaternion::new_normalize(q + (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0));
            if with_derivatives {
                // The middle of the cubic through both ends with their slopes.
                let last = slope(&end);
                let middle = UnitQuaternion::new_normalize((q + end.into_inner()) * 0.5 + (k1 - last) * (h / 8.0));
                state.carry_derivatives(&[state.R_WO, middle, end], h);
            }
            state.R_WO = end;
            if steps == 1.0 {
                break;
            }
            left_s -= h;
        }
        state
    }

    /// The state after turning at a steady rate: R → exp(ωt)·R, so δθ → exp(ωt)·δθ + t·J(ωt)·δω.
    fn after_turning(&self, duration_s: f64, with_derivatives: bool) -> Self {
        let turn = UnitQuaternion::from_scaled_axis(self.momentum * duration_s);
        let mut state = *self;
        state.R_WO = turn * self.R_WO;
        if with_derivatives {
            state.by_start = turn.to_rotation_matrix().matrix() * self.by_start;
            let mut by_rate = state.by_start.fixed_view_mut::<3, 3>(0, 3);
            by_rate += left_jacobian(&(self.momentum * duration_s)) * (duration_s * self.left);
        }
        state
    }

    /// One step of the derivatives, given the orientations at its start, middle and end.
    fn carry_derivatives(&mut self, R_WO: &[UnitQuaternion<f64>; 3], h: f64) {
        let mobility = R_WO.map(|R_WO| self.mobility(&R_WO));
        let (twist, left) = (self.momentum.cross_matrix(), self.left);
        let slope = |mobility: &Matrix3<f64>, by_start: &SMatrix<f64, 3, 6>| {
            let mut inner = twist * by_start;
            let mut by_momentum = inner.fixed_view_mut::<3, 3>(0, 3);
            by_momentum += Matrix3::identity() * left;
            mobility * inner
        };
        let k1 = slope(&mobility[0], &self.by_start);
        let k2 = slope(&mobility[1], &(self.by_start + k1 * (h / 2.0)));
        let k3 = slope(&mobility[1], &(self.by_start + k2 * (h / 2.0)));
        let k4 = slope(&mobility[2], &(self.by_start + k3 * h));
        self.by_start += (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0);
    }

    /// ∂θ/∂(θ₀, ω₀), given the state at the start.
    ///
    /// L = J_W·ω gives δL = δθ₀×L − J_W(δθ₀×ω) + J_W·δω₀.
    pub fn by_orientation_and_rate(&self, start: &Self) -> SMatrix<f64, 3, 6> {
        if self.steady {
            return self.by_start;
        }
        let R = start.R_WO.to_rotation_matrix();
        let inertia_W = R.matrix() * start.inertia * R.matrix().transpose();
        let by_momentum = self.by_start.fixed_view::<3, 3>(0, 3);
        let turn = inertia_W * start.w_WO().cross_matrix() - start.momentum.cross_matrix();
        let mut result = SMatrix::<f64, 3, 6>::zeros();
        result.fixed_view_mut::<3, 3>(0, 0).copy_from(&(self.by_start.fixed_view::<3, 3>(0, 0) + by_momentum * turn));
        result.fixed_view_mut::<3, 3>(0, 3).copy_from(&(by_momentum * inertia_W));
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn start() -> (UnitQuaternion<f64>, Vector3<f64>, Matrix3<f64>) {
        let inertia = Matrix3::new(0.0002, 0.00006, 0.0, 0.00006, 0.0017, 0.0, 0.0, 0.0, 0.0018);
        (UnitQuaternion::from_euler_angles(0.3, 0.5, -0.2), Vector3::new(5.0, 2.0, -4.0), inertia)
    }

    #[test]
    fn energy_stays_and_time_can_be_reversed() {
        let (R, w, inertia) = start();
        let from = Tumbling::new(R, &w, Some(&inertia));
        let later = from.after(0.7, false);
        let energy = |state: &Tumbling| state.w_WO().dot(&state.momentum);
        assert!((energy(&later) / energy(&from) - 1.0).abs() < 1e-4);
        assert!((later.w_WO() - w).norm() > 1.0, "it tumbles");
        let back = later.after(-0.7, false);
        assert!(back.R_WO.angle_to(&R) < 1e-4, "{}", back.R_WO.angle_to(&R));
    }

    #[test]
    fn without_inertia_the_rate_stays() {
        let (R, w, _) = start();
        let later = Tumbling::new(R, &w, None).after(0.5, true);
        assert!(later.R_WO.angle_to(&(UnitQuaternion::from_scaled_axis(w * 0.5) * R)) < 1e-4);
    }

    #[test]
    fn derivatives_are_those_of_the_orientation() {
        let (R, w, inertia) = start();
        for (inertia, decay) in [(None, 0.0), (Some(&inertia), 0.0), (None, 0.8), (Some(&inertia), 0.8)] {
            let from = Tumbling::new(R, &w, inertia).decaying(decay);
            let analytic = from.after(0.1, true).after(0.2, true).by_orientation_and_rate(&from);
            for i in 0..6 {
                let h = 1e-5;
                let at = |sign: f64| {
                    let mut change = [0.0; 6];
                    change[i] = sign * h;
                    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(change[0], change[1], change[2]));
                    let w = w + Vector3::new(change[3], change[4], change[5]);
                    Tumbling::new(turn * R, &w, inertia).decaying(decay).after(0.3, false).R_WO
                };
                let numeric = (at(1.0) * at(-1.0).inverse()).scaled_axis() / (2.0 * h);
                assert!((numeric - analytic.column(i)).norm() < 1e-4, "{i}: {numeric} {}", analytic.column(i));
            }
        }
    }

    #[test]
    fn a_momentum_that_decays_slows_the_rotation_down() {
        let (R, w, inertia) = start();
        for inertia in [None, Some(&inertia)] {
            let at = |decay: f64| Tumbling::new(R, &w, inertia).decaying(decay).after(0.2, false).after(0.2, false);
            let (free, slowed) = (at(0.0), at(0.5));
            assert!((slowed.momentum - free.momentum * libm::exp(-0.2f64)).norm() < 1e-9 * free.momentum.norm());
            for decay in [0.0, 0.5] {
                let h = 1e-4;
                let numeric = (at(decay + h).R_WO * at(decay - h).R_WO.inverse()).scaled_axis() / (2.0 * h);
                assert!((numeric - at(decay).by_decay()).norm() < 1e-3 * numeric.norm(), "{decay}: {numeric}");
            }
        }
    }
}
