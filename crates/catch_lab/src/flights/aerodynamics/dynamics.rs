//! Motion of a rigid body in air: gravity, drag by direction, Magnus force, Euler's equations with a decay of the spin.
//!
//! v̇ = g − |v|·R·D·Rᵀ·v + k·(R·ω)×v, Ṙ = R·[ω]ₓ, ω̇ = J⁻¹·(J·ω×ω) − c·ω, with ω and all matrices in the body frame, and J = exp(S)
//! with S symmetric and traceless: always positive definite, and only ratios of the inertia matter. The tracked point lies
//! at p + R·r. Perturbations of the orientation are in the body frame: R·exp([δθ]ₓ).

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

/// Number of parameters: r, D (xx, yy, zz, xy, xz, yz), k, c, S (xx, yy, xy, xz, yz).
pub const PARAMETERS: usize = 16;
/// Of the error state: (p, v, θ, ω) and the parameters.
pub(super) const N: usize = 12 + PARAMETERS;
pub(super) const V: usize = 3;
pub(super) const THETA: usize = 6;
pub(super) const OMEGA: usize = 9;
/// First parameter: the tracked point.
pub(super) const POINT: usize = 12;
const DRAG: usize = 15;
const MAGNUS: usize = 21;
const DECAY: usize = 22;
const INERTIA: usize = 23;

/// Parameters as a vector, in SI units.
pub type ParameterVector = SVector<f64, PARAMETERS>;
/// Error state, and its covariance.
pub(super) type ErrorState = SVector<f64, N>;
pub(super) type Covariance = SMatrix<f64, N, N>;
/// Derivatives of the next (p, v, θ, ω) with respect to the error state.
pub(super) type Transition = SMatrix<f64, 12, N>;
/// Derivatives of a vector with respect to the error state.
type ByState = SMatrix<f64, 3, N>;

/// Position and velocity of the centre of mass, orientation, and angular velocity in the body frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct State {
    pub p: Vector3<f64>,
    pub v: Vector3<f64>,
    pub R: UnitQuaternion<f64>,
    pub w: Vector3<f64>,
}

/// The parameters in the form in which the equations of motion use them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Body {
    pub parameters: ParameterVector,
    /// The tracked point in the body frame, from the centre of mass.
    pub r: Vector3<f64>,
    drag: Matrix3<f64>,
    magnus: f64,
    decay: f64,
    inertia: Matrix3<f64>,
    inverse: Matrix3<f64>,
    /// ∂J/∂S.
    by_shape: [Matrix3<f64>; 5],
}

/// Unit symmetric matrices: the derivatives of D by its six elements.
fn symmetric_unit(i: usize) -> Matrix3<f64> {
    let (row, column) = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)][i];
    let mut unit = Matrix3::zeros();
    unit[(row, column)] = 1.0;
    unit[(column, row)] = 1.0;
    unit
}

/// Derivatives of S by its five elements.
fn traceless_unit(i: usize) -> Matrix3<f64> {
    match i {
        0 | 1 => symmetric_unit(i) - symmetric_unit(2),
        _ => symmetric_unit(i + 1),
    }
}

impl Body {
    pub fn new(parameters: &ParameterVector) -> Self {
        let at = |i: usize| parameters[i - POINT];
        let drag = (0..6).map(|i| symmetric_unit(i) * at(DRAG + i)).sum();
        let shape: Matrix3<f64> = (0..5).map(|i| traceless_unit(i) * at(INERTIA + i)).sum();
        // exp(U·Λ·Uᵀ) = U·exp(Λ)·Uᵀ; its derivative along E is U·(Γ∘(Uᵀ·E·U))·Uᵀ with Γᵢⱼ = (exp λᵢ − exp λⱼ)/(λᵢ − λⱼ).
        let eigen = shape.symmetric_eigen();
        let (basis, roots) = (eigen.eigenvectors, eigen.eigenvalues);
        let power = |sign: f64| basis * Matrix3::from_diagonal(&(roots * sign).map(f64::exp)) * basis.transpose();
        let slopes = Matrix3::from_fn(|i, j| {
            let (middle, half) = (f64::midpoint(roots[i], roots[j]), 0.5 * (roots[i] - roots[j]));
            middle.exp() * if half.abs() > 1e-4 { half.sinh() / half } else { 1.0 + half * half / 6.0 }
        });
        let by_shape = std::array::from_fn(|i| {
            let inner = basis.transpose() * traceless_unit(i) * basis;
            basis * inner.component_mul(&slopes) * basis.transpose()
        });
        Self {
            parameters: *parameters,
            r: parameters.fixed_rows::<3>(0).into_owned(),
            drag,
            magnus: at(MAGNUS),
            decay: at(DECAY),
            inertia: power(1.0),
            inverse: power(-1.0),
            by_shape,
        }
    }

    /// Angular acceleration in the body frame.
    fn spin_rate(&self, w: &Vector3<f64>) -> Vector3<f64> {
        self.inverse * (self.inertia * w).cross(w) - w * self.decay
    }

    /// Its derivative, given that of ω: δω̇ = J⁻¹(δ(J·ω)×ω + J·ω×δω − δJ·ω̇ᵢ) − c·δω − ω·δc, ω̇ᵢ without the decay.
    fn spin_rate_by(&self, w: &Vector3<f64>, dw: &ByState) -> ByState {
        let momentum = self.inertia * w;
        let inertial = self.inverse * momentum.cross(w);
        let jacobian = self.inverse * (momentum.cross_matrix() - w.cross_matrix() * self.inertia)
            - Matrix3::identity() * self.decay;
        let mut by = jacobian * dw;
        let mut by_decay = by.column_mut(DECAY);
        by_decay -= w;
        for (i, change) in self.by_shape.iter().enumerate() {
            let mut column = by.column_mut(INERTIA + i);
            column += self.inverse * ((change * w).cross(w) - change * inertial);
        }
        by
    }

    /// Acceleration of the centre of mass.
    fn acceleration(
        &self,
        g: &Vector3<f64>,
        v: &Vector3<f64>,
        R: &UnitQuaternion<f64>,
        w: &Vector3<f64>,
    ) -> Vector3<f64> {
        g - R * (self.drag * (R.inverse() * v)) * v.norm() + (R * w).cross(v) * self.magnus
    }

    /// Its derivative, given those of v, θ and ω.
    fn acceleration_by(
        &self,
        (v, dv): (&Vector3<f64>, &ByState),
        (R, dtheta): (&UnitQuaternion<f64>, &ByState),
        (w, dw): (&Vector3<f64>, &ByState),
    ) -> ByState {
        let (speed, R) = (v.norm(), R.to_rotation_matrix().into_inner());
        let in_body = R.transpose() * v;
        let force = self.drag * in_body;
        let world_drag = R * self.drag * R.transpose();
        let along = if speed > 1e-9 { world_drag * v * v.transpose() / speed } else { Matrix3::zeros() };
        let by_v = (R * w).cross_matrix() * self.magnus - world_drag * speed - along;
        let turned = v.cross_matrix() * R;
        let by_theta = turned * w.cross_matrix() * self.magnus
            - R * (self.drag * in_body.cross_matrix() - force.cross_matrix()) * speed;
        let mut by = by_v * dv + by_theta * dtheta - turned * dw * self.magnus;
        for i in 0..6 {
            let mut column = by.column_mut(DRAG + i);
            column -= R * (symmetric_unit(i) * in_body) * speed;
        }
        let mut column = by.column_mut(MAGNUS);
        column += (R * w).cross(v);
        by
    }

    /// The state `h` seconds later, by the midpoint rule.
    pub fn step(&self, g: &Vector3<f64>, from: &State, h: f64) -> State {
        let State { p, v, R, w } = from;
        let w_middle = w + self.spin_rate(w) * (h / 2.0);
        let R_middle = R * UnitQuaternion::from_scaled_axis(w * (h / 2.0));
        let v_middle = v + self.acceleration(g, v, R, w) * (h / 2.0);
        let acceleration = self.acceleration(g, &v_middle, &R_middle, &w_middle);
        State {
            p: p + v * h + acceleration * (h * h / 2.0),
            v: v + acceleration * h,
            R: R * UnitQuaternion::from_scaled_axis(w_middle * h),
            w: w + self.spin_rate(&w_middle) * h,
        }
    }

    /// [`step`](Self::step) and its derivatives.
    pub fn step_with_derivatives(&self, g: &Vector3<f64>, from: &State, h: f64) -> (State, Transition) {
        let State { v, R, w, .. } = from;
        let unit = |at: usize| {
            let mut by = ByState::zeros();
            by.fixed_view_mut::<3, 3>(0, at).fill_with_identity();
            by
        };
        let (dp, dv, dtheta, dw) = (unit(0), unit(V), unit(THETA), unit(OMEGA));
        let w_middle = w + self.spin_rate(w) * (h / 2.0);
        let dw_middle = dw + self.spin_rate_by(w, &dw) * (h / 2.0);
        let R_middle = R * UnitQuaternion::from_scaled_axis(w * (h / 2.0));
        let dtheta_middle = rotated_by(&(w * (h / 2.0)), &dtheta, &(dw * (h / 2.0)));
        let v_middle = v + self.acceleration(g, v, R, w) * (h / 2.0);
        let dv_middle = dv + self.acceleration_by((v, &dv), (R, &dtheta), (w, &dw)) * (h / 2.0);
        let by = self.acceleration_by((&v_middle, &dv_middle), (&R_middle, &dtheta_middle), (&w_middle, &dw_middle));
        let mut transition = Transition::zeros();
        transition.fixed_view_mut::<3, N>(0, 0).copy_from(&(dp + dv * h + by * (h * h / 2.0)));
        transition.fixed_view_mut::<3, N>(V, 0).copy_from(&(dv + by * h));
        let theta = rotated_by(&(w_middle * h), &dtheta, &(dw_middle * h));
        transition.fixed_view_mut::<3, N>(THETA, 0).copy_from(&theta);
        transition.fixed_view_mut::<3, N>(OMEGA, 0).copy_from(&(dw + self.spin_rate_by(&w_middle, &dw_middle) * h));
        (self.step(g, from, h), transition)
    }
}

/// Derivative of the perturbation of R·exp(φ), given those of R and of φ: exp(−φ)·δθ + Jᵣ(φ)·δφ with
/// Jᵣ(φ) = 1 − (1 − cos φ)/φ²·[φ]ₓ + (φ − sin φ)/φ³·[φ]ₓ².
fn rotated_by(phi: &Vector3<f64>, dtheta: &ByState, dphi: &ByState) -> ByState {
    let (angle, cross) = (phi.norm(), phi.cross_matrix());
    let (first, second) = if angle > 1e-3 {
        ((1.0 - angle.cos()) / (angle * angle), (angle - angle.sin()) / angle.powi(3))
    } else {
        (0.5, 1.0 / 6.0)
    };
    let back = UnitQuaternion::from_scaled_axis(-phi).to_rotation_matrix().into_inner();
    back * dtheta + (Matrix3::identity() - cross * first + cross * cross * second) * dphi
}

impl State {
    /// This state after a small change of (p, v, θ, ω).
    pub fn moved(&self, change: &ErrorState) -> Self {
        Self {
            p: self.p + change.fixed_rows::<3>(0),
            v: self.v + change.fixed_rows::<3>(V),
            R: self.R * UnitQuaternion::from_scaled_axis(change.fixed_rows::<3>(THETA).into_owned()),
            w: self.w + change.fixed_rows::<3>(OMEGA),
        }
    }

    /// The change of (p, v, θ, ω) that leads from `other` to this state.
    pub fn since(&self, other: &Self) -> SVector<f64, 12> {
        let mut change = SVector::<f64, 12>::zeros();
        change.fixed_rows_mut::<3>(0).copy_from(&(self.p - other.p));
        change.fixed_rows_mut::<3>(V).copy_from(&(self.v - other.v));
        change.fixed_rows_mut::<3>(THETA).copy_from(&(other.R.inverse() * self.R).scaled_axis());
        change.fixed_rows_mut::<3>(OMEGA).copy_from(&(self.w - other.w));
        change
    }

    /// Position and velocity of the tracked point.
    pub fn tracked_point(&self, body: &Body) -> (Vector3<f64>, Vector3<f64>) {
        (self.p + self.R * body.r, self.v + self.R * self.w.cross(&body.r))
    }

    /// Derivatives of [`tracked_point`](Self::tracked_point) with respect to the error state.
    pub fn tracked_point_by(&self, body: &Body) -> SMatrix<f64, 6, N> {
        let R = self.R.to_rotation_matrix().into_inner();
        let mut by = SMatrix::<f64, 6, N>::zeros();
        by.fixed_view_mut::<6, 6>(0, 0).fill_with_identity();
        by.fixed_view_mut::<3, 3>(0, THETA).copy_from(&(R * body.r.cross_matrix() * -1.0));
        by.fixed_view_mut::<3, 3>(0, POINT).copy_from(&R);
        by.fixed_view_mut::<3, 3>(V, THETA).copy_from(&(R * self.w.cross(&body.r).cross_matrix() * -1.0));
        by.fixed_view_mut::<3, 3>(V, OMEGA).copy_from(&(R * body.r.cross_matrix() * -1.0));
        by.fixed_view_mut::<3, 3>(V, POINT).copy_from(&(R * self.w.cross_matrix()));
        by
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> (State, ParameterVector) {
        let state = State {
            p: Vector3::new(1.0, 2.0, 3.0),
            v: Vector3::new(4.0, 3.0, -5.0),
            R: UnitQuaternion::from_euler_angles(0.3, -0.8, 1.2),
            w: Vector3::new(8.0, -12.0, 5.0),
        };
        let parameters = ParameterVector::from_column_slice(&[
            0.01, -0.02, 0.03, 0.08, 0.12, 0.03, 0.01, -0.02, 0.015, 0.003, 0.3, 0.4, -0.6, 0.2, 0.1, -0.3,
        ]);
        (state, parameters)
    }

    #[test]
    fn derivatives_are_those_of_finite_differences() {
        let (state, parameters) = example();
        let g = Vector3::new(0.0, -9.81, 0.0);
        let (_, analytic) = Body::new(&parameters).step_with_derivatives(&g, &state, 0.02);
        let points = state.tracked_point_by(&Body::new(&parameters));
        for i in 0..N {
            let h = 1e-6;
            let at = |sign: f64| {
                let mut change = ErrorState::zeros();
                change[i] = sign * h;
                let body = Body::new(&(parameters + change.fixed_rows::<PARAMETERS>(POINT)));
                let moved = state.moved(&change);
                (body.step(&g, &moved, 0.02), moved.tracked_point(&body))
            };
            let ((more, more_point), (less, less_point)) = (at(1.0), at(-1.0));
            let numeric = more.since(&less) / (2.0 * h);
            assert!((numeric - analytic.column(i)).norm() < 1e-6, "{i}: {numeric} {}", analytic.column(i));
            let position = (more_point.0 - less_point.0) / (2.0 * h) - points.fixed_view::<3, 1>(0, i);
            let velocity = (more_point.1 - less_point.1) / (2.0 * h) - points.fixed_view::<3, 1>(V, i);
            assert!(position.norm() < 1e-7 && velocity.norm() < 1e-6, "{i}: {position} {velocity}");
        }
    }

    #[test]
    fn without_air_momentum_and_energy_stay() {
        let (start, mut parameters) = example();
        for i in 3..11 {
            parameters[i] = 0.0;
        }
        let body = Body::new(&parameters);
        let momentum = |state: &State| state.R * (body.inertia * state.w);
        let mut state = start;
        for _ in 0..1000 {
            state = body.step(&Vector3::new(0.0, 0.0, -9.81), &state, 1e-3);
        }
        assert!((momentum(&state) - momentum(&start)).norm() < 1e-2 * momentum(&start).norm());
        let fallen = start.p + start.v - Vector3::new(0.0, 0.0, 4.905);
        assert!((state.p - fallen).norm() < 1e-9, "{}", state.p - fallen);
    }
}
