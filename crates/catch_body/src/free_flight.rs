//! Motion of a rigid body in free flight, with its derivatives: gravity, drag, Magnus force, free rotation
//! whose spin decays.
//!
//! v̇ = g − |v|·R·D·Rᵀ·v + k·(R·ω)×v + s×v + a, Ṙ = R·(ω×), ω̇ = J⁻¹·(J·ω×ω) − c·ω + α, with ω and all
//! matrices in the body frame. D = exp(M) with M symmetric, so that air never accelerates; J = exp(S) with S
//! symmetric and traceless, because only ratios of the inertia matter. s is the Magnus force of a spin that
//! nobody measured, k·ω in the world; a and α disturb the motion. A tracked point lies at p + R·r.
//! Perturbations of the orientation are in the body frame: R·exp(δθ×).

pub mod ballistic;
pub mod tumbling;

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

use crate::pose::left_jacobian;

/// Number of parameters: r, M (xx, yy, zz, xy, xz, yz), k, c, S (xx, yy, xy, xz, yz), s.
pub const PARAMETERS: usize = 19;
/// Dimension of the error state: (p, v, θ, ω) and the parameters.
pub const N: usize = 12 + PARAMETERS;
/// First element of the velocity in the error state.
pub const V: usize = 3;
/// First element of the rotation in the error state.
pub const THETA: usize = 6;
/// First element of the angular velocity in the error state.
pub const OMEGA: usize = 9;
/// First parameter of the tracked point in the error state.
pub const POINT: usize = 12;
/// First parameter of the drag in the error state.
pub const DRAG: usize = 15;
/// Magnus coefficient in the error state.
pub const MAGNUS: usize = 21;
/// Decay of the spin in the error state.
pub const DECAY: usize = 22;
/// First parameter of the inertia in the error state.
pub const INERTIA: usize = 23;
/// First parameter of the lift in the error state.
pub const LIFT: usize = 28;

/// Parameters as a vector, in SI units.
pub type ParameterVector = SVector<f64, PARAMETERS>;
/// Derivatives of the next (p, v, θ, ω) with respect to the error state.
pub type Transition = SMatrix<f64, 12, N>;
/// Derivatives of a vector with respect to the error state.
type ByState = SMatrix<f64, 3, N>;

/// Position and velocity of the centre of mass, orientation, and angular velocity in the body frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeState {
    /// Position in metres.
    pub p: Vector3<f64>,
    /// Velocity in m/s.
    pub v: Vector3<f64>,
    /// Orientation of the body in the world.
    pub R: UnitQuaternion<f64>,
    /// Angular velocity in the body frame, in rad/s.
    pub w: Vector3<f64>,
}

/// The accelerations from outside that a step has: gravity, and what disturbs the motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pushes {
    /// Gravity and other accelerations in the world, in m/s².
    pub acceleration: Vector3<f64>,
    /// Angular acceleration in the body frame, in rad/s².
    pub angular: Vector3<f64>,
}

/// The parameters in the form in which the equations of motion use them.
#[derive(Debug, Clone, Copy)]
pub struct FlyingBody {
    /// The parameters.
    pub parameters: ParameterVector,
    /// The tracked point in the body frame, from the centre of mass.
    pub r: Vector3<f64>,
    /// Drag matrix D in 1/m.
    pub drag: Matrix3<f64>,
    /// Magnus coefficient k.
    pub magnus: f64,
    /// Decay c of the spin in 1/s.
    pub decay: f64,
    /// Inertia tensor J, of determinant one.
    pub inertia: Matrix3<f64>,
    /// Lift s in the world, in 1/s.
    pub lift: Vector3<f64>,
    inverse: Matrix3<f64>,
    /// ∂D/∂M and ∂J/∂S.
    by_drag: [Matrix3<f64>; 6],
    by_shape: [Matrix3<f64>; 5],
}

/// Unit symmetric matrices: the derivatives of M by its six elements.
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

/// The exponential of a symmetric matrix and its derivatives along others.
///
/// exp(U·Λ·Uᵀ) = U·exp(Λ)·Uᵀ; its derivative along E is U·(Γ∘(Uᵀ·E·U))·Uᵀ with Γᵢⱼ = (exp λᵢ − exp λⱼ)/(λᵢ −
/// λⱼ).
fn exponential<const COUNT: usize>(
    matrix: &Matrix3<f64>,
    along: fn(usize) -> Matrix3<f64>,
) -> (Matrix3<f64>, [Matrix3<f64>; COUNT]) {
    let eigen = matrix.symmetric_eigen();
    let (basis, roots) = (eigen.eigenvectors, eigen.eigenvalues);
    let slopes = Matrix3::from_fn(|i, j| {
        let (middle, half) = (f64::midpoint(roots[i], roots[j]), 0.5 * (roots[i] - roots[j]));
        libm::exp(middle) * if half.abs() > 1e-4 { libm::sinh(half) / half } else { 1.0 + half * half / 6.0 }
    });
    let by = std::array::from_fn(|i| {
        let inner = basis.transpose() * along(i) * basis;
        basis * inner.component_mul(&slopes) * basis.transpose()
    });
    (basis * Matrix3::from_diagonal(&roots.map(libm::exp)) * basis.transpose(), by)
}

impl FlyingBody {
    /// A body with these parameters.
    pub fn new(parameters: &ParameterVector) -> Self {
        let at = |i: usize| parameters[i - POINT];
        let drag: Matrix3<f64> = (0..6).map(|i| symmetric_unit(i) * at(DRAG + i)).sum();
        let shape: Matrix3<f64> = (0..5).map(|i| traceless_unit(i) * at(INERTIA + i)).sum();
        let (drag, by_drag) = exponential(&drag, symmetric_unit);
        let (inertia, by_shape) = exponential(&shape, traceless_unit);
        Self {
            parameters: *parameters,
            r: parameters.fixed_rows::<3>(0).into_owned(),
            drag,
            magnus: at(MAGNUS),
            decay: at(DECAY),
            inertia,
            inverse: exponential::<0>(&-shape, traceless_unit).0,
            lift: parameters.fixed_rows::<3>(LIFT - POINT).into_owned(),
            by_drag,
            by_shape,
        }
    }

    /// Angular acceleration in the body frame, disturbances aside.
    fn spin_rate(&self, w: &Vector3<f64>) -> Vector3<f64> {
        self.inverse * (self.inertia * w).cross(w) - w * self.decay
    }

    /// Derivative of [`Self::spin_rate`], given that of ω: δω̇ = J⁻¹(δ(J·ω)×ω + J·ω×δω − δJ·ω̇ᵢ) − c·δω −
    /// ω·δc, ω̇ᵢ without the decay.
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

    /// Acceleration of the centre of mass by the air.
    pub fn air(&self, v: &Vector3<f64>, R: &UnitQuaternion<f64>, w: &Vector3<f64>) -> Vector3<f64> {
        (R * w * self.magnus + self.lift).cross(v) - R * (self.drag * (R.inverse() * v)) * v.norm()
    }

    /// Derivative of [`Self::air`], given those of v, θ and ω.
    fn air_by(
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
        let by_v = (R * w * self.magnus + self.lift).cross_matrix() - world_drag * speed - along;
        let turned = v.cross_matrix() * R;
        let by_theta = turned * w.cross_matrix() * self.magnus
            - R * (self.drag * in_body.cross_matrix() - force.cross_matrix()) * speed;
        let mut by = by_v * dv + by_theta * dtheta - turned * dw * self.magnus;
        for (i, change) in self.by_drag.iter().enumerate() {
            let mut column = by.column_mut(DRAG + i);
            column -= R * (change * in_body) * speed;
        }
        let mut column = by.column_mut(MAGNUS);
        column += (R * w).cross(v);
        let mut by_lift = by.fixed_columns_mut::<3>(LIFT);
        by_lift -= v.cross_matrix();
        by
    }

    /// The state `h` seconds later, or earlier if negative, by the midpoint rule.
    pub fn step(&self, pushes: &Pushes, from: &FreeState, h: f64) -> FreeState {
        let FreeState { p, v, R, w } = from;
        let w_middle = w + (self.spin_rate(w) + pushes.angular) * (h / 2.0);
        let R_middle = R * UnitQuaternion::from_scaled_axis(w * (h / 2.0));
        let v_middle = v + (pushes.acceleration + self.air(v, R, w)) * (h / 2.0);
        let acceleration = pushes.acceleration + self.air(&v_middle, &R_middle, &w_middle);
        FreeState {
            p: p + v * h + acceleration * (h * h / 2.0),
            v: v + acceleration * h,
            R: R * UnitQuaternion::from_scaled_axis(w_middle * h),
            w: w + (self.spin_rate(&w_middle) + pushes.angular) * h,
        }
    }

    /// [`step`](Self::step) and its derivatives.
    pub fn step_with_derivatives(&self, pushes: &Pushes, from: &FreeState, h: f64) -> (FreeState, Transition) {
        let FreeState { v, R, w, .. } = from;
        let unit = |at: usize| {
            let mut by = ByState::zeros();
            by.fixed_view_mut::<3, 3>(0, at).fill_with_identity();
            by
        };
        let (dp, dv, dtheta, dw) = (unit(0), unit(V), unit(THETA), unit(OMEGA));
        let w_middle = w + (self.spin_rate(w) + pushes.angular) * (h / 2.0);
        let dw_middle = dw + self.spin_rate_by(w, &dw) * (h / 2.0);
        let R_middle = R * UnitQuaternion::from_scaled_axis(w * (h / 2.0));
        let dtheta_middle = rotated_by(&(w * (h / 2.0)), &dtheta, &(dw * (h / 2.0)));
        let v_middle = v + (pushes.acceleration + self.air(v, R, w)) * (h / 2.0);
        let dv_middle = dv + self.air_by((v, &dv), (R, &dtheta), (w, &dw)) * (h / 2.0);
        let by = self.air_by((&v_middle, &dv_middle), (&R_middle, &dtheta_middle), (&w_middle, &dw_middle));
        let mut transition = Transition::zeros();
        transition.fixed_view_mut::<3, N>(0, 0).copy_from(&(dp + dv * h + by * (h * h / 2.0)));
        transition.fixed_view_mut::<3, N>(V, 0).copy_from(&(dv + by * h));
        let theta = rotated_by(&(w_middle * h), &dtheta, &(dw_middle * h));
        transition.fixed_view_mut::<3, N>(THETA, 0).copy_from(&theta);
        transition.fixed_view_mut::<3, N>(OMEGA, 0).copy_from(&(dw + self.spin_rate_by(&w_middle, &dw_middle) * h));
        (self.step(pushes, from, h), transition)
    }

    /// Position and velocity of the tracked point.
    pub fn tracked_point(&self, state: &FreeState) -> (Vector3<f64>, Vector3<f64>) {
        (state.p + state.R * self.r, state.v + state.R * state.w.cross(&self.r))
    }

    /// Derivatives of [`tracked_point`](Self::tracked_point) with respect to the error state.
    pub fn tracked_point_by(&self, state: &FreeState) -> SMatrix<f64, 6, N> {
        let R = state.R.to_rotation_matrix().into_inner();
        let mut by = SMatrix::<f64, 6, N>::zeros();
        by.fixed_view_mut::<6, 6>(0, 0).fill_with_identity();
        by.fixed_view_mut::<3, 3>(0, THETA).copy_from(&(R * self.r.cross_matrix() * -1.0));
        by.fixed_view_mut::<3, 3>(0, POINT).copy_from(&R);
        by.fixed_view_mut::<3, 3>(V, THETA).copy_from(&(R * state.w.cross(&self.r).cross_matrix() * -1.0));
        by.fixed_view_mut::<3, 3>(V, OMEGA).copy_from(&(R * self.r.cross_matrix() * -1.0));
        by.fixed_view_mut::<3, 3>(V, POINT).copy_from(&(R * state.w.cross_matrix()));
        by
    }
}

/// Derivative of the perturbation of R·exp(φ), given those of R and of φ: exp(−φ)·δθ + J(−φ)·δφ.
fn rotated_by(phi: &Vector3<f64>, dtheta: &ByState, dphi: &ByState) -> ByState {
    let back = UnitQuaternion::from_scaled_axis(-phi).to_rotation_matrix().into_inner();
    back * dtheta + left_jacobian(&-phi) * dphi
}

impl FreeState {
    /// State after a small change of (p, v, θ, ω).
    pub fn moved(&self, change: &SVector<f64, 12>) -> Self {
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
}
