//! Estimation of an object's aerodynamics along with its flight: drag by direction, a force across the
//! flight, and its centre of mass.
//!
//! a = g − k·|v|·v + f with f = −|v|·R·E·Rᵀ·v + (c_M·ω + s)×v: E is symmetric, without trace and fixed to the
//! object, and has the symmetry of its shape; c_M is the Magnus coefficient, and s that times the part of the
//! spin that cannot be seen, about the axis of a body of revolution or about any of a ball. This is the
//! motion of the centre of mass, at c in O (on the axis of a body of revolution). The orientations of the
//! poses are taken as they are, and velocities and angular velocities as fitted before, so that position,
//! velocity, k, E, c_M, s and c follow from one linear problem with Gaussian priors.

use catch_body::{dynamics::gravity, quantity, symmetry::Symmetry};
use nalgebra::{Cholesky, Const, Matrix3, Rotation3, SMatrix, SVector, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    AerodynamicForces, Config, FIT_WINDOW, FlightTrajectory, LEAST_DRAG_PER_M,
    agreement::{is_finite, of_position},
    correlated_error::CorrelatedSums,
    process_noise::{add_product, after_impulse, lost_square},
};
use crate::perception::ObjectPose;

/// Prior of the forces. Zero by default: there are none.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct AerodynamicPrior {
    /// Standard deviation in 1/m of E's elements along the principal axes of inertia; of those beside them a
    /// fifth.
    pub drag_deviation_sd_per_m: quantity::drag_per_m,
    /// Magnus coefficient c_M that is expected.
    pub magnus: quantity::magnus,
    /// Standard deviation of the Magnus coefficient.
    pub magnus_sd: quantity::magnus,
    /// Standard deviation of each component of s, in rad/s. Where no Magnus coefficient is expected, s is the
    /// lift of all spin, seen or not.
    pub lift_sd_radps: quantity::speed_radps,
    /// Decay c of the spin that is expected, ω̇ = −c·ω, in 1/s.
    pub spin_decay_per_s: quantity::decay_per_s,
    /// Standard deviation of the spin's decay, in 1/s.
    pub spin_decay_sd_per_s: quantity::decay_per_s,
}

impl AerodynamicPrior {
    /// Returns whether any forces are expected.
    pub fn any(&self) -> bool {
        self.drag_deviation_sd_per_m > 0.0 || self.magnus > 0.0 || self.magnus_sd > 0.0 || self.lift_sd_radps > 0.0
    }
}

/// Elements of E.
const E: usize = 5;
/// Parameters: position, velocity, k, elements of E, s, c_M, c.
const N: usize = 19;
const DRAG: usize = 6;
const DEVIATION: usize = 7;
const LIFT: usize = DEVIATION + E;
const MAGNUS: usize = LIFT + 3;
const COM: usize = MAGNUS + 1;
/// Number of the parameters on which accelerations depend.
const FORCES: usize = COM - DRAG;
/// Ratio of E's standard deviation beside the principal axes of inertia to that along them: where shape and
/// mass have planes of symmetry, there is none.
const ACROSS: f64 = 0.2;
/// Passes of reweighting, and the error in scaled standard deviations at which a weight has fallen to a
/// quarter.
const PASSES: usize = 3;
const OUTLIER_SD: f64 = 4.0;

/// A basis of the matrices E that have the object's symmetry; what is left of it is zero.
fn deviations(symmetry: &Symmetry) -> [Matrix3<f64>; E] {
    let pair = |i: usize, j: usize| {
        let mut unit = Matrix3::zeros();
        (unit[(i, j)], unit[(j, i)]) = (1.0, 1.0);
        unit
    };
    let mut basis = [Matrix3::zeros(); E];
    match symmetry {
        Symmetry::Finite { inertia_per_kg, .. } => {
            let along = |diagonal: [f64; 3]| Matrix3::from_diagonal(&Vector3::from(diagonal));
            let across = [pair(0, 1), pair(0, 2), pair(1, 2)].map(|unit| unit * ACROSS);
            let axes = inertia_per_kg.symmetric_eigen().eigenvectors;
            basis = [along([1.0, -1.0, 0.0]), along([-0.5, -0.5, 1.0]), across[0], across[1], across[2]]
                .map(|unit| axes * unit * axes.transpose());
        }
        Symmetry::Axis { axis, .. } => {
            basis[0] = axis.into_inner() * axis.transpose() * 1.5 - Matrix3::identity() * 0.5;
        }
        Symmetry::Sphere => {}
    }
    basis
}

/// A basis of the centres of mass in O that are fixed to what can be seen of the object's orientation; what
/// is left of it is zero.
fn centres(symmetry: &Symmetry) -> Matrix3<f64> {
    match symmetry {
        Symmetry::Finite { .. } => Matrix3::identity(),
        Symmetry::Axis { axis, .. } => Matrix3::from_columns(&[axis.into_inner(), Vector3::zeros(), Vector3::zeros()]),
        Symmetry::Sphere => Matrix3::zeros(),
    }
}

/// Dependence of s on its parameters, at an orientation of the object.
#[derive(Debug, Clone, Copy)]
enum UnseenSpin {
    /// Fixed in W: the parameters are its components.
    World,
    /// The spin is along an axis in O: the first parameter is its length.
    Along(Unit<Vector3<f64>>),
    /// There is no unseen spin.
    None,
}

impl UnseenSpin {
    /// ∂(s×v)/∂(its parameters).
    fn acceleration_by(self, R_WO: &Rotation3<f64>, v: &Vector3<f64>) -> Matrix3<f64> {
        let mut by = Matrix3::zeros();
        match self {
            Self::World => by = -v.cross_matrix(),
            Self::Along(axis) => by.set_column(0, &(R_WO * axis.into_inner()).cross(v)),
            Self::None => {}
        }
        by
    }
}

/// Model of an object's parameters, by its symmetry.
struct Model<'a> {
    config: &'a Config,
    basis: [Matrix3<f64>; E],
    centres: Matrix3<f64>,
    unseen: UnseenSpin,
    /// True if the spin that is seen may cause lift.
    has_lift: bool,
}

/// Accelerations by the parameters from the drag constant on.
type ByForces = SMatrix<f64, 3, FORCES>;
type Parameters = SVector<f64, N>;
type Covariance = SMatrix<f64, N, N>;

impl<'a> Model<'a> {
    fn new(symmetry: &Symmetry, config: &'a Config) -> Self {
        let has_magnus = config.aerodynamics.magnus > 0.0 || config.aerodynamics.magnus_sd > 0.0;
        let unseen = match symmetry {
            Symmetry::Axis { axis, .. } if has_magnus => UnseenSpin::Along(*axis),
            Symmetry::Finite { .. } if has_magnus => UnseenSpin::None,
            _ => UnseenSpin::World,
        };
        let has_lift = has_magnus && !matches!(symmetry, Symmetry::Sphere);
        Self { config, basis: deviations(symmetry), centres: centres(symmetry), unseen, has_lift }
    }

    /// Accelerations by each parameter, at an orientation, a velocity and an angular velocity; of the unseen
    /// spin, `left` has not decayed.
    fn accelerations(&self, R_WO: &UnitQuaternion<f64>, v: &Vector3<f64>, w: &Vector3<f64>, left: f64) -> ByForces {
        let mut by = ByForces::zeros();
        by.set_column(0, &(v * -v.norm()));
        let R = R_WO.to_rotation_matrix();
        let in_body = R.inverse() * v;
        for (i, unit) in self.basis.iter().enumerate() {
            by.set_column(1 + i, &(R * (unit * in_body) * -v.norm()));
        }
        by.fixed_view_mut::<3, 3>(0, LIFT - DRAG).copy_from(&(self.unseen.acceleration_by(&R, v) * left));
        by.set_column(MAGNUS - DRAG, &(if self.has_lift { w.cross(v) } else { Vector3::zeros() }));
        by
    }

    /// A row for each pose, newest first, and the accelerations at the flight's time: backward from there by
    /// the trapezoid rule, the velocity along the flight as it was fitted.
    fn rows(&self, poses: &[ObjectPose], flight: &FlightTrajectory, rows: &mut Vec<Row>) -> ByForces {
        rows.clear();
        rows.reserve(FIT_WINDOW);
        let mut v = flight.v_WOcm;
        let mut tumbling = flight.tumbling();
        let newest = self.accelerations(&flight.R_WO, &v, &flight.w_WO, 1.0);
        let mut last = newest;
        let (mut by_velocity, mut by_position) = (last * 0.0, last * 0.0);
        let mut age_s = 0.0;
        for pose in poses.iter().rev().filter(|pose| is_finite(pose)) {
            let h = (flight.time_s - pose.capture_s - age_s).max(0.0);
            v -= (gravity() - v * (flight.drag_per_m * v.norm())) * h;
            tumbling = tumbling.after(-h, false);
            let left = libm::exp(flight.spin_decay_per_s * (age_s + h));
            let now = self.accelerations(&pose.X_WO.rotation, &v, &tumbling.w_WO(), left);
            let mean = (last + now) * 0.5;
            by_position += mean * (0.5 * h * h) - by_velocity * h;
            by_velocity -= mean * h;
            (age_s, last) = (age_s + h, now);
            let mut by = SMatrix::<f64, 3, N>::zeros();
            by.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            by.fixed_view_mut::<3, 3>(0, 3).fill_diagonal(-age_s);
            by.fixed_view_mut::<3, FORCES>(0, DRAG).copy_from(&by_position);
            let R_WO = tumbling.R_WO.to_rotation_matrix();
            by.fixed_view_mut::<3, 3>(0, COM).copy_from(&-(R_WO * self.centres));
            let p_W = pose.X_WO.translation.vector;
            let rest = p_W - gravity() * (0.5 * age_s * age_s);
            rows.push(Row { age_s, p_W, by, rest, information: of_position(pose), weight: 1.0 });
        }
        newest
    }

    /// Prior mean of the parameters, and their prior information.
    fn prior(&self) -> (Parameters, Parameters) {
        let AerodynamicPrior { drag_deviation_sd_per_m, magnus, magnus_sd, lift_sd_radps, .. } =
            self.config.aerodynamics;
        let mut expected = Parameters::zeros();
        (expected[DRAG], expected[MAGNUS]) = (self.config.drag_per_m(), magnus);
        let of = |sd: f64| sd.max(1e-7).powi(-2);
        let mut known = Parameters::repeat(1e-6);
        known[DRAG] = of(self.config.drag_sd_per_m());
        known.fixed_rows_mut::<E>(DEVIATION).fill(of(drag_deviation_sd_per_m));
        known.fixed_rows_mut::<3>(LIFT).fill(of(lift_sd_radps));
        known[MAGNUS] = of(magnus_sd);
        known.fixed_rows_mut::<3>(COM).fill(of(self.config.com_sd_m()));
        (expected, known)
    }

    /// The parameters that all rows and the prior agree on, and the inverse of their information; what the
    /// common error of the rows does to them is added to `correlated`. `None` if the arithmetic failed.
    fn solved(
        &self,
        rows: &[Row],
        scale: f64,
        mut correlated: Option<&mut CorrelatedSums<N>>,
    ) -> Option<(Parameters, Cholesky<f64, Const<N>>)> {
        let noise = self.config.process_noise.acceleration;
        let (mut H, mut g) = (Covariance::zeros(), Parameters::zeros());
        let mut older_s = None;
        for row in rows.iter().rev() {
            if let Some(older_s) = older_s.replace(row.age_s) {
                let variance = noise.powi(2) * (older_s - row.age_s);
                if variance > 0.0 {
                    let middle_s = f64::midpoint(older_s, row.age_s);
                    let gain = after_impulse(&mut H, &mut g, [0, 3], middle_s, variance);
                    if let (Some(gain), Some(correlated)) = (gain, &mut correlated) {
                        correlated.after_impulse(&gain, [0, 3], middle_s);
                    }
                }
            }
            let by = row.by.transpose();
            let pulled = by * row.information * (row.weight / (scale * scale));
            add_product(&mut H, &pulled, &by);
            g -= pulled * row.rest;
            if let Some(correlated) = &mut correlated {
                correlated.add(row.age_s, &row.p_W, &pulled);
            }
        }
        let (expected, known) = self.prior();
        H += SMatrix::from_diagonal(&known);
        g -= known.component_mul(&expected);
        let factor = H.cholesky()?;
        Some((-factor.solve(&g), factor))
    }

    /// Weighs the rows anew by their errors, and tells how large these are.
    ///
    /// The noise of the process displaces older poses: the newest ones tell how large the errors are.
    fn reweighted(&self, rows: &mut [Row], x: &Parameters, scale: f64) -> f64 {
        let (mut squares, mut freedom) = (12.0, 12.0);
        for row in rows.iter_mut() {
            let error = row.rest - row.by * x;
            let lost = lost_square(&row.information, &error, self.config.process_noise.acceleration, row.age_s);
            let square = (error.dot(&(row.information * error)) - lost).max(0.0) / 3.0;
            row.weight = (1.0 + square / (OUTLIER_SD * scale).powi(2)).powi(-2);
            squares += row.weight * square * 3.0;
            freedom += row.weight * 3.0;
        }
        f64::sqrt(squares / freedom)
    }

    /// Puts what was found into a flight; `newest` are the accelerations at its time.
    fn put(&self, flight: &mut FlightTrajectory, x: &Parameters, covariance: &Covariance, newest: &ByForces) {
        let Self { config, basis, centres, unseen, has_lift } = self;
        flight.p_WOcm = x.fixed_rows::<3>(0).into_owned().into();
        flight.v_WOcm = x.fixed_rows::<3>(3).into_owned();
        flight.drag_per_m = x[DRAG].clamp(LEAST_DRAG_PER_M, config.most_drag_per_m());
        flight.covariance = covariance.fixed_view::<7, 7>(0, 0).into_owned();
        if config.com_sd_m() > 0.0 {
            flight.com_O = centres * x.fixed_rows::<3>(COM);
            let of_com = covariance.fixed_columns::<3>(COM) * centres.transpose();
            flight.com_covariance.fixed_rows_mut::<6>(0).copy_from(&of_com.fixed_rows::<6>(0));
            flight.com_covariance.fixed_rows_mut::<3>(6).copy_from(&(centres * of_com.fixed_rows::<3>(COM)));
        }
        if config.aerodynamics.any() {
            let deviation = basis.iter().enumerate().map(|(i, unit)| unit * x[DEVIATION + i]).sum();
            flight.forces = AerodynamicForces {
                drag_deviation_O: braking(flight.drag_per_m, deviation, config.most_drag_per_m()),
                magnus: if *has_lift { x[MAGNUS] } else { 0.0 },
                ..AerodynamicForces::default()
            };
            match unseen {
                UnseenSpin::World => flight.forces.lift_W = x.fixed_rows::<3>(LIFT).into_owned(),
                UnseenSpin::Along(axis) => flight.forces.lift_O = axis.into_inner() * x[LIFT],
                UnseenSpin::None => {}
            }
            let by_forces = newest.fixed_columns::<{ COM - DEVIATION }>(1).transpose();
            let of_forces = covariance.fixed_columns::<{ COM - DEVIATION }>(DEVIATION) * by_forces;
            flight.force_covariance.fixed_rows_mut::<6>(0).copy_from(&of_forces.fixed_rows::<6>(0));
            let own = by_forces.transpose() * of_forces.fixed_rows::<{ COM - DEVIATION }>(DEVIATION);
            flight.force_covariance.fixed_rows_mut::<3>(6).copy_from(&own);
        }
    }
}

/// The dependence of the position at one time on the parameters, and what remains of the position without
/// them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    age_s: f64,
    p_W: Vector3<f64>,
    by: SMatrix<f64, 3, N>,
    rest: Vector3<f64>,
    information: Matrix3<f64>,
    weight: f64,
}

/// Refines a fitted flight: its position, velocity and drag constant together with the forces and the centre
/// of mass. `poses` are oldest first, and those the flight was fitted to. `None` if the arithmetic failed,
/// which leaves the flight as it was.
pub(super) fn refine(
    poses: &[ObjectPose],
    flight: &mut FlightTrajectory,
    symmetry: &Symmetry,
    config: &Config,
    rows: &mut Vec<Row>,
) -> Option<()> {
    let model = Model::new(symmetry, config);
    let newest = model.rows(poses, flight, rows);
    let mut scale = 1.0;
    for _ in 0..PASSES {
        let (x, _) = model.solved(rows, scale, None)?;
        scale = model.reweighted(rows, &x, scale);
    }
    let mut correlated = CorrelatedSums::of(config.correlated_sd_per_m);
    let (x, factor) = model.solved(rows, scale, correlated.as_mut())?;
    let inverse = factor.inverse();
    let of_correlated = correlated.map_or_else(SMatrix::zeros, |it| it.covariance(&inverse));
    let is_finite = x.iter().all(|value| value.is_finite());
    is_finite.then(|| model.put(flight, &x, &(inverse + of_correlated), &newest))
}

/// Deviation E with which the drag matrix k·1 + E brakes in all directions: a body that air drove would soon
/// have any speed.
fn braking(drag_per_m: f64, deviation: Matrix3<f64>, most_per_m: f64) -> Matrix3<f64> {
    let drag = Matrix3::from_diagonal_element(drag_per_m);
    let mut along = (drag + deviation).symmetric_eigen();
    if along.eigenvalues.iter().all(|it| (LEAST_DRAG_PER_M..=most_per_m).contains(it)) {
        return deviation;
    }
    along.eigenvalues.apply(|it| *it = it.clamp(LEAST_DRAG_PER_M, most_per_m));
    along.recompose() - drag
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An estimated flight loses energy to the air, whatever was found, but for noise.
    #[test]
    fn air_brakes_in_all_directions() {
        for deviation in [Vector3::new(-10.0, 4.0, 6.0), Vector3::new(0.5, -0.1, -0.4), Vector3::new(3.0, 3.0, -6.0)] {
            let axes = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.7, 0.5)).to_rotation_matrix();
            let found = axes * Matrix3::from_diagonal(&deviation) * axes.inverse();
            let drag = Matrix3::identity() * 0.02 + braking(0.02, found, 1.0);
            let along = drag.symmetric_eigenvalues();
            assert!(along.min() > LEAST_DRAG_PER_M - 1e-9 && along.max() < 1.0 + 1e-9, "{along}");
        }
        let plausible = Matrix3::from_diagonal(&Vector3::new(0.01, -0.02, 0.01));
        assert_eq!(braking(0.02, plausible, 1.0), plausible);
        // Drag of a feather, known beforehand.
        assert_eq!(braking(3.0, plausible, 3.1), plausible);
    }
}
