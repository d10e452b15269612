//! The flight that fits all poses best, by what each pose's information is worth.
//!
//! Minimizes Σ ρ(eᵢᵀ·Wᵢ·eᵢ / s²) + (k − k̄)²/σ_k² + |ω|²/σ_ω² over (p, v, k, R, ω) at the time of the newest pose, eᵢ being the
//! turn and shift from the flight to pose i and Wᵢ its information, by Gauss–Newton with reweighting. Outliers weigh nothing
//! (ρ of Geman and McClure); the scale s, by which the poses err more or less than they say, is estimated along.

use catch_body::Pose;
use nalgebra::{Point3, SMatrix, SVector, UnitQuaternion, Vector3, Vector6};

use super::{
    Config, FlightTrajectory, PredictionStatus, flight::Motion, ransac::is_finite, tumbling, tumbling::Tumbling,
};
use crate::perception::{ObjectPose, Symmetry};

/// Number of parameters: position, velocity, drag constant, attitude, angular velocity.
const N: usize = 13;
const DRAG: usize = 6;
const TURN: usize = 7;
const SPIN: usize = 10;

/// Error in scaled standard deviations per degree of freedom at which a pose's weight has fallen to a quarter.
const OUTLIER_SD: f64 = 4.0;
/// Degrees of freedom that "the errors are as the poses say" counts for when their scale is estimated.
const SCALE_PRIOR_DOF: f64 = 12.0;
/// A fit has come to rest when a step is shorter than this share of its standard deviation.
const STEP_SD: f64 = 0.01;

/// State that is being fitted.
#[derive(Debug, Clone, Copy)]
struct State {
    p: Vector3<f64>,
    v: Vector3<f64>,
    drag_per_m: f64,
    R_WO: UnitQuaternion<f64>,
    w: Vector3<f64>,
}

/// Sums over all poses.
struct Sums {
    information: SMatrix<f64, N, N>,
    gradient: SVector<f64, N>,
    /// Σ w·eᵀWe and Σ w·(degrees of freedom).
    squares: f64,
    freedom: f64,
    inliers: usize,
}

/// Fits a flight to `poses`, oldest first, from `start`.
pub(super) fn fit(
    poses: &[ObjectPose],
    start: &FlightTrajectory,
    symmetry: &Symmetry,
    config: &Config,
) -> Result<FlightTrajectory, PredictionStatus> {
    let newest_s =
        poses.iter().filter(|pose| is_finite(pose)).map(|pose| pose.capture_s).fold(f64::NEG_INFINITY, f64::max);
    if !newest_s.is_finite() {
        return Err(PredictionStatus::TooFewPoses);
    }
    let X_WO = start.pose_at(newest_s);
    let twist = start.twist_at(newest_s);
    let mut state = State {
        p: X_WO.translation.vector,
        v: twist.linear,
        drag_per_m: start.drag_per_m,
        R_WO: X_WO.rotation,
        w: twist.angular,
    };
    let freedom = match symmetry {
        Symmetry::None { .. } => 6.0,
        Symmetry::Axis { .. } => 5.0,
        Symmetry::Sphere => 3.0,
    };
    let problem = Problem { poses, newest_s, symmetry, inertia: tumbling::inertia(symmetry), freedom, config };

    // The poses near the start are taken for the good ones; how far the nearer half of as many is off sets the scale.
    let good = super::ransac::count_agreeing(poses, start, config).max(2);
    let mut scale = problem.typical_error(&state, good).max(1.0);
    let mut converged = false;
    for _ in 0..config.max_iterations {
        let sums = problem.sums(&state, scale);
        let (information, gradient) = problem.with_priors(&sums, &state, scale);
        let factor = information.cholesky().ok_or(PredictionStatus::NotConverged)?;
        let step = -factor.solve(&gradient);
        if !step.iter().all(|value| value.is_finite()) {
            return Err(PredictionStatus::NotConverged);
        }
        state = state.moved(&step, config);
        let shrunk = problem.typical_error(&state, good).clamp(0.3, scale.max(1.0));
        converged = step.dot(&(information * step)).sqrt() < STEP_SD && shrunk > 0.7 * scale;
        scale = shrunk;
        if converged {
            break;
        }
    }
    let sums = problem.sums(&state, scale);
    if !converged && scale > 10.0 {
        return Err(PredictionStatus::NotConverged);
    }
    let error_scale = ((sums.squares + SCALE_PRIOR_DOF) / (sums.freedom + SCALE_PRIOR_DOF)).sqrt();
    let (information, _) = problem.with_priors(&sums, &state, error_scale);
    let covariance = information.cholesky().ok_or(PredictionStatus::NotConverged)?.inverse();
    Ok(FlightTrajectory {
        time_s: newest_s,
        p_WO: Point3::from(state.p),
        v_WO: state.v,
        R_WO: state.R_WO,
        w_WO: state.w,
        drag_per_m: state.drag_per_m,
        inertia_per_kg: problem.inertia,
        covariance: covariance.fixed_view::<7, 7>(0, 0).into_owned(),
        rotation_covariance: covariance.fixed_view::<6, 6>(TURN, TURN).into_owned(),
        systematic_sd_m: config.systematic_sd_m,
        inliers: sums.inliers,
        considered: poses.len(),
        error_scale,
    })
}

struct Problem<'a> {
    poses: &'a [ObjectPose],
    newest_s: f64,
    symmetry: &'a Symmetry,
    inertia: Option<nalgebra::Matrix3<f64>>,
    freedom: f64,
    config: &'a Config,
}

impl State {
    fn moved(&self, step: &SVector<f64, N>, config: &Config) -> Self {
        let turn = step.fixed_rows::<3>(TURN).into_owned();
        // Drag never accelerates; half the prior's width below zero is left to noise.
        let least = -0.5 * config.drag_prior_sd_per_m;
        Self {
            p: self.p + step.fixed_rows::<3>(0),
            v: self.v + step.fixed_rows::<3>(3),
            drag_per_m: (self.drag_per_m + step[DRAG]).clamp(least.min(config.drag_prior_per_m), 1.0),
            R_WO: UnitQuaternion::from_scaled_axis(turn * (0.5 / turn.norm()).min(1.0)) * self.R_WO,
            w: self.w + step.fixed_rows::<3>(SPIN),
        }
    }
}

impl Problem<'_> {
    /// Calls `visit` with each pose and the flight's motion and attitude at its time, from the newest to the oldest.
    fn fly(&self, state: &State, with_derivatives: bool, mut visit: impl FnMut(&ObjectPose, &Motion, &Tumbling)) {
        let mut motion = Motion::new(state.p, state.v);
        let mut tumbling = Tumbling::new(state.R_WO, &state.w, self.inertia.as_ref());
        let mut time_s = self.newest_s;
        for pose in self.poses.iter().rev().filter(|pose| is_finite(pose)) {
            let elapsed_s = pose.capture_s - time_s;
            if elapsed_s != 0.0 {
                motion = motion.after(elapsed_s, state.drag_per_m, with_derivatives);
                tumbling = tumbling.after(elapsed_s, with_derivatives);
            }
            time_s = pose.capture_s;
            visit(pose, &motion, &tumbling);
        }
    }

    /// Turn and shift from the flight to a pose.
    fn error(&self, pose: &ObjectPose, motion: &Motion, tumbling: &Tumbling) -> Vector6<f64> {
        let X_WO: &Pose = &pose.X_WO;
        let turn = self.symmetry.turn_between(&tumbling.R_WO, &X_WO.rotation);
        let shift = X_WO.translation.vector - motion.p;
        Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
    }

    /// Median of √(eᵀWe / degrees of freedom) over the `good` poses where it is smallest.
    fn typical_error(&self, state: &State, good: usize) -> f64 {
        let mut squares: Vec<f64> = Vec::with_capacity(self.poses.len());
        self.fly(state, false, |pose, motion, tumbling| {
            let e = self.error(pose, motion, tumbling);
            squares.push(e.dot(&(pose.information * e)) / self.freedom);
        });
        let middle = good.min(squares.len()) / 2;
        if squares.is_empty() {
            return 1.0;
        }
        squares.select_nth_unstable_by(middle, f64::total_cmp).1.max(0.0).sqrt()
    }

    fn sums(&self, state: &State, scale: f64) -> Sums {
        let mut sums =
            Sums { information: SMatrix::zeros(), gradient: SVector::zeros(), squares: 0.0, freedom: 0.0, inliers: 0 };
        let start = Tumbling::new(state.R_WO, &state.w, self.inertia.as_ref());
        self.fly(state, true, |pose, motion, tumbling| {
            let e = self.error(pose, motion, tumbling);
            let square = e.dot(&(pose.information * e)).max(0.0);
            let in_sd = (square / self.freedom).sqrt() / scale;
            let weight = (1.0 + (in_sd / OUTLIER_SD).powi(2)).powi(-2);
            // ∂(flight's turn and shift)/∂(p, v, k, θ, ω); the error falls as these rise.
            let mut J = SMatrix::<f64, 6, N>::zeros();
            J.fixed_view_mut::<3, 3>(3, 0).fill_with_identity();
            J.fixed_view_mut::<3, 4>(3, 3).copy_from(&motion.dp);
            J.fixed_view_mut::<3, 6>(0, TURN).copy_from(&tumbling.by_attitude_and_rate(&start));
            let weighted = J.transpose() * pose.information * weight;
            sums.information += weighted * J;
            sums.gradient -= weighted * e;
            sums.squares += weight * square;
            sums.freedom += weight * self.freedom;
            sums.inliers += usize::from(in_sd < OUTLIER_SD);
        });
        sums
    }

    /// The normal equations with the priors on drag and spin, and a trace of one on everything, for what is not observed.
    fn with_priors(&self, sums: &Sums, state: &State, scale: f64) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
        let mut information = sums.information / (scale * scale);
        let mut gradient = sums.gradient / (scale * scale);
        for i in 0..N {
            information[(i, i)] += if i < TURN { 1e-6 } else { 1e-3 };
        }
        // A drag that is known is held by a width of 10⁻⁷ 1/m.
        let drag = self.config.drag_prior_sd_per_m.max(1e-7).powi(-2);
        information[(DRAG, DRAG)] += drag;
        gradient[DRAG] += drag * (state.drag_per_m - self.config.drag_prior_per_m);
        let spin = self.config.spin_prior_sd_radps.max(1e-6).powi(-2);
        for i in 0..3 {
            information[(SPIN + i, SPIN + i)] += spin;
            gradient[SPIN + i] += spin * state.w[i];
        }
        (information, gradient)
    }
}
