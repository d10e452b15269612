//! The flight that fits all poses best, by what each pose's information is worth.
//!
//! Minimizes Σ ρ(eᵢᵀ·Wᵢ·eᵢ / s²) + (k − k̄)²/σ_k² + |ω|²/σ_ω² + (c − c̄)²/σ_c² over (p, v, k, R, ω, c) at the time of the newest pose, eᵢ being the
//! turn and shift from the flight to pose i and Wᵢ its information, by Gauss–Newton with reweighting. Outliers weigh nothing
//! (ρ of Geman and McClure); the scale s, by which the poses err more or less than they say, is estimated along.

mod row;
mod state;

use catch_body::Pose;
use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

use super::{
    AerodynamicForces, Config, FlightTrajectory, LocalFlight, PredictionStatus,
    correlated_error::CorrelatedSums,
    flight::Motion,
    process_noise::after_impulse,
    ransac::{is_finite, reach_m},
    tumbling,
    tumbling::Tumbling,
};
use crate::perception::{ObjectPose, Symmetry};
use row::Row;
use state::{DECAY, DRAG, N, ROTATION, SPIN, State, TURN, solved};

/// Error in scaled standard deviations per degree of freedom at which a pose's weight has fallen to a quarter.
const OUTLIER_SD: f64 = 4.0;
/// Degrees of freedom that "the errors are as the poses say" counts for when their scale is estimated.
const SCALE_PRIOR_DOF: f64 = 12.0;
/// A fit has come to rest when a step is shorter than this fraction of its standard deviation.
const STEP_SD: f64 = 0.05;
/// Within this many standard deviations the flight is as good as linear in its parameters.
const LINEAR_SD: f64 = 0.5;

/// Sums over all poses.
struct Sums {
    information: SMatrix<f64, N, N>,
    gradient: SVector<f64, N>,
    /// Σ w·eᵀWe and Σ w·(degrees of freedom).
    squares: f64,
    freedom: f64,
    inliers: usize,
    /// What errors that poses have in common do to the gradient, if that was asked for.
    correlated: Option<CorrelatedSums<N>>,
}

/// Buffers of the fit.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    rows: Vec<Row>,
    squares: Vec<f64>,
}

/// Fits a flight to `poses`, oldest first, from `start`.
///
/// Also returns how many of the newest `window` poses agree with the fitted flight.
pub(super) fn fit(
    poses: &[ObjectPose],
    start: &FlightTrajectory,
    symmetry: &Symmetry,
    config: &Config,
    scratch: &mut Scratch,
) -> Result<(FlightTrajectory, usize), PredictionStatus> {
    let newest_s =
        poses.iter().filter(|pose| is_finite(pose)).map(|pose| pose.capture_s).fold(f64::NEG_INFINITY, f64::max);
    if !newest_s.is_finite() {
        return Err(PredictionStatus::TooFewPoses);
    }
    let LocalFlight { X_WO, V_WO, .. } = start.local_flight_at(newest_s);
    let mut state = State {
        p: X_WO.translation.vector,
        v: V_WO.linear,
        drag_per_m: start.drag_per_m,
        R_WO: X_WO.rotation,
        w: V_WO.angular,
        decay_per_s: if config.spin_decay_sd_per_s() > 0.0 {
            start.spin_decay_per_s
        } else {
            config.spin_decay_per_s()
        },
    };
    let freedom = match symmetry {
        Symmetry::Finite { .. } => 6.0,
        Symmetry::Axis { .. } => 5.0,
        Symmetry::Sphere => 3.0,
    };
    let (inertia, forces) = (tumbling::inertia_per_kg(symmetry), start.forces);
    let problem = Problem { poses, newest_s, symmetry, inertia, forces, freedom, config };

    // The poses near the start are taken for the good ones; how far the nearer half of as many is off sets the scale.
    let near_start = problem.linearize(&state, poses.len(), scratch);
    let good = near_start.max(2);
    let mut scale = problem.typical_error(good, scratch).max(1.0);
    let mut agreeing = near_start;
    let mut converged = false;
    for _ in 0..config.max_iterations {
        let sums = problem.sums(scale, scale, None, scratch);
        let (information, gradient) = problem.with_priors(&sums, &state, scale);
        let step = -solved(&information, &gradient, config).ok_or(PredictionStatus::NotConverged)?;
        if !step.iter().all(|value| value.is_finite()) {
            return Err(PredictionStatus::NotConverged);
        }
        let step_sd = step.dot(&(information * step)).sqrt();
        let before = state;
        state = state.moved(&step, config);
        agreeing = if step_sd < LINEAR_SD {
            problem.advance(&state.since(&before), config.window, scratch)
        } else {
            problem.linearize(&state, config.window, scratch)
        };
        let shrunk = problem.typical_error(good, scratch).clamp(0.3, scale.max(1.0));
        converged = step_sd < STEP_SD && shrunk > 0.7 * scale;
        scale = shrunk;
        if converged {
            break;
        }
    }
    let correlated = config.correlated_error.sums();
    let sums = problem.sums(scale, scale, correlated.clone(), scratch);
    if !converged && scale > 10.0 {
        return Err(PredictionStatus::NotConverged);
    }
    let error_scale = ((sums.squares + SCALE_PRIOR_DOF) / (sums.freedom + SCALE_PRIOR_DOF)).sqrt();
    let sums = if config.process_noise.any() { problem.sums(scale, error_scale, correlated, scratch) } else { sums };
    let (information, _) = problem.with_priors(&sums, &state, error_scale);
    let mut covariance =
        solved::<N>(&information, &SMatrix::identity(), config).ok_or(PredictionStatus::NotConverged)?;
    if let Some(correlated) = &sums.correlated {
        covariance += correlated.covariance(&covariance) / error_scale.powi(4);
    }
    let flight = FlightTrajectory {
        time_s: newest_s,
        p_WO: Point3::from(state.p),
        v_WO: state.v,
        R_WO: state.R_WO,
        w_WO: state.w,
        drag_per_m: state.drag_per_m,
        spin_decay_per_s: state.decay_per_s,
        inertia_per_kg: problem.inertia,
        covariance: covariance.fixed_view::<7, 7>(0, 0).into_owned(),
        rotation_covariance: covariance.fixed_view::<6, 6>(TURN, TURN).into_owned(),
        systematic_sd_m: config.systematic_sd_m,
        process_noise: config.process_noise,
        com_O: Vector3::zeros(),
        com_covariance: SMatrix::zeros(),
        forces: problem.forces,
        force_covariance: SMatrix::zeros(),
        inliers: sums.inliers,
        considered: poses.len(),
        error_scale,
    };
    Ok((flight, agreeing))
}

struct Problem<'a> {
    poses: &'a [ObjectPose],
    newest_s: f64,
    symmetry: &'a Symmetry,
    inertia: Option<Matrix3<f64>>,
    /// Those of the flight from which the fit starts.
    forces: AerodynamicForces,
    freedom: f64,
    config: &'a Config,
}

impl Problem<'_> {
    /// Flies from the newest pose to the oldest and notes how the flight stands to each. Returns how many of the newest
    /// `window` poses agree with it.
    fn linearize(&self, state: &State, window: usize, scratch: &mut Scratch) -> usize {
        scratch.rows.clear();
        // Room for as many poses as there will ever be, so that it is made once.
        scratch.rows.reserve(self.config.fit_window);
        scratch.squares.reserve(self.config.fit_window);
        let start = Tumbling::new(state.R_WO, &state.w, self.inertia.as_ref()).decaying(state.decay_per_s);
        // A decay that is known has no part in the fit.
        let decays = self.config.spin_decay_sd_per_s() > 0.0;
        let (mut motion, mut tumbling) = (Motion::new(state.p, state.v), start);
        let mut time_s = self.newest_s;
        let turns = !matches!(self.symmetry, Symmetry::Sphere);
        let force = |motion: &Motion, tumbling: &Tumbling| {
            self.forces.acceleration_mps2(&tumbling.R_WO, &motion.v, &tumbling.w_WO(), tumbling.left)
        };
        // How far the forces have moved the object, and their part of its velocity.
        let (mut pushed_m, mut pushed_mps) = (Vector3::zeros(), Vector3::zeros());
        let mut agreeing = 0;
        for (age, pose) in self.poses.iter().rev().enumerate().filter(|(_, pose)| is_finite(pose)) {
            let elapsed_s = pose.capture_s - time_s;
            if elapsed_s != 0.0 {
                let before = (motion, tumbling);
                motion = motion.after(elapsed_s, state.drag_per_m, true);
                if turns || self.forces.any() {
                    tumbling = tumbling.after(elapsed_s, true);
                }
                if self.forces.any() {
                    let mean = (force(&before.0, &before.1) + force(&motion, &tumbling)) * 0.5;
                    pushed_m += pushed_mps * elapsed_s + mean * (0.5 * elapsed_s * elapsed_s);
                    pushed_mps += mean * elapsed_s;
                }
            }
            time_s = pose.capture_s;
            let X_WO: &Pose = &pose.X_WO;
            let mut row = Row {
                age_s: self.newest_s - pose.capture_s,
                p_W: X_WO.translation.vector,
                turn: Vector3::zeros(),
                shift: X_WO.translation.vector - motion.p - pushed_m,
                by_rotation: SMatrix::zeros(),
                by_motion: motion.dp,
                turns: Matrix3::zeros(),
                mixed: Matrix3::zeros(),
                shifts: pose.information.fixed_view::<3, 3>(3, 3).into_owned(),
                square: 0.0,
            };
            if turns {
                row.turn = self.symmetry.turn_between(&tumbling.R_WO, &X_WO.rotation);
                let by_start = tumbling.by_orientation_and_rate(&start);
                row.by_rotation.fixed_view_mut::<3, 6>(0, 0).copy_from(&by_start);
                if decays {
                    row.by_rotation.set_column(DECAY - TURN, &tumbling.by_decay());
                }
                row.turns = pose.information.fixed_view::<3, 3>(0, 0).into_owned();
                row.mixed = pose.information.fixed_view::<3, 3>(0, 3).into_owned();
            }
            row.weigh(turns, &self.config.process_noise);
            agreeing += usize::from(age < window && row.shift.norm() < reach_m(pose, self.config));
            scratch.rows.push(row);
        }
        agreeing
    }

    /// The rows after a step that is short enough for their derivatives to hold. Returns how many of the newest `window` poses
    /// agree with the flight then.
    fn advance(&self, step: &SVector<f64, N>, window: usize, scratch: &mut Scratch) -> usize {
        let turns = !matches!(self.symmetry, Symmetry::Sphere);
        let (p, motion) = (step.fixed_rows::<3>(0), step.fixed_rows::<4>(3));
        let rotation = step.fixed_rows::<ROTATION>(TURN);
        let poses = self.poses.iter().rev().enumerate().filter(|(_, pose)| is_finite(pose));
        let mut agreeing = 0;
        for (row, (age, pose)) in scratch.rows.iter_mut().zip(poses) {
            row.shift -= p + row.by_motion * motion;
            if turns {
                row.turn -= row.by_rotation * rotation;
            }
            row.weigh(turns, &self.config.process_noise);
            agreeing += usize::from(age < window && row.shift.norm() < reach_m(pose, self.config));
        }
        agreeing
    }

    /// Median of √(eᵀWe / degrees of freedom) over the `good` poses where it is smallest.
    fn typical_error(&self, good: usize, scratch: &mut Scratch) -> f64 {
        let Scratch { rows, squares } = scratch;
        squares.clear();
        squares.extend(rows.iter().map(|row| row.square / self.freedom));
        let middle = good.min(squares.len()) / 2;
        if squares.is_empty() {
            return 1.0;
        }
        squares.select_nth_unstable_by(middle, f64::total_cmp).1.sqrt()
    }

    /// Σ w·JᵀWJ and Σ w·JᵀWe. The noise of the process counts as for poses whose errors are scaled by `noise_scale`.
    ///
    /// With noise they are gathered from the oldest pose on: between two poses, Δt apart, impulses of variance q²·Δt have changed velocity and
    /// angular velocity. An impulse u of age τ is τ·u in the position now and u in the velocity; drag and tumbling are left out of that.
    fn sums(&self, scale: f64, noise_scale: f64, correlated: Option<CorrelatedSums<N>>, scratch: &Scratch) -> Sums {
        let (information, gradient) = (SMatrix::zeros(), SVector::zeros());
        let mut sums = Sums { information, gradient, squares: 0.0, freedom: 0.0, inliers: 0, correlated };
        let noise = self.config.process_noise;
        if noise.any() {
            let mut older_s = None;
            for row in scratch.rows.iter().rev() {
                if let Some(older_s) = older_s.replace(row.age_s) {
                    self.lose_to_noise(&mut sums, [older_s, row.age_s], noise_scale);
                }
                self.add(&mut sums, row, scale);
            }
        } else {
            for row in &scratch.rows {
                self.add(&mut sums, row, scale);
            }
        }
        sums.information.fill_lower_triangle_with_upper_triangle();
        sums
    }

    /// What the noise between two ages leaves of what the poses till then tell.
    fn lose_to_noise(&self, sums: &mut Sums, [older_s, age_s]: [f64; 2], noise_scale: f64) {
        let noise = self.config.process_noise;
        let variance = |density: f64| density.powi(2) * (older_s - age_s) / noise_scale.powi(2);
        let middle_s = f64::midpoint(older_s, age_s);
        sums.information.fill_lower_triangle_with_upper_triangle();
        for (blocks, density) in [([0, 3], noise.acceleration), ([TURN, SPIN], noise.angular_acceleration)] {
            let variance = variance(density);
            if variance > 0.0 {
                let gain = after_impulse(&mut sums.information, &mut sums.gradient, blocks, middle_s, variance);
                if let (Some(gain), Some(correlated)) = (gain, &mut sums.correlated) {
                    correlated.after_impulse(&gain, blocks, middle_s);
                }
            }
        }
    }

    /// Adds a row, block by block: J is [1, ∂shift] on position, velocity and drag, and ∂turn on the rest. Of the information, the upper
    /// triangle is filled.
    fn add(&self, sums: &mut Sums, row: &Row, scale: f64) {
        let turns = !matches!(self.symmetry, Symmetry::Sphere);
        let H = &mut sums.information;
        let add = |H: &mut SMatrix<f64, N, N>, at: (usize, usize), block: &Matrix3<f64>| {
            let mut view = H.fixed_view_mut::<3, 3>(at.0, at.1);
            view += block;
        };
        let in_sd = row.in_sd(self.freedom, scale);
        let weight = (1.0 + (in_sd / OUTLIER_SD).powi(2)).powi(-2);
        let shifts = row.shifts * weight;
        let by_motion = shifts * row.by_motion;
        add(H, (0, 0), &shifts);
        let mut view = H.fixed_view_mut::<3, 4>(0, 3);
        view += by_motion;
        let mut view = H.fixed_view_mut::<4, 4>(3, 3);
        view += row.by_motion.transpose() * by_motion;
        let mut push = shifts * row.shift;
        if turns {
            let mixed = row.mixed * weight;
            push += mixed.transpose() * row.turn;
            let by_rotation = row.by_rotation.transpose();
            let crossed = mixed.transpose() * row.by_rotation;
            let mut view = H.fixed_view_mut::<3, ROTATION>(0, TURN);
            view += crossed;
            let mut view = H.fixed_view_mut::<4, ROTATION>(3, TURN);
            view += row.by_motion.transpose() * crossed;
            let mut view = H.fixed_view_mut::<ROTATION, ROTATION>(TURN, TURN);
            view += by_rotation * (row.turns * weight * row.by_rotation);
            let mut view = sums.gradient.fixed_rows_mut::<ROTATION>(TURN);
            view -= by_rotation * (row.turns * row.turn * weight + mixed * row.shift);
        }
        let mut view = sums.gradient.fixed_rows_mut::<3>(0);
        view -= push;
        let mut view = sums.gradient.fixed_rows_mut::<4>(3);
        view -= row.by_motion.transpose() * push;
        sums.squares += weight * row.square;
        sums.freedom += weight * self.freedom;
        sums.inliers += usize::from(in_sd < OUTLIER_SD);
        if let Some(correlated) = &mut sums.correlated {
            correlated.add(row.age_s, &row.p_W, &(row.by_position() * weight));
        }
    }

    /// The normal equations with the priors on drag and spin, and a trace of one on everything, for what is not observed.
    fn with_priors(&self, sums: &Sums, state: &State, scale: f64) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
        let mut information = sums.information / (scale * scale);
        let mut gradient = sums.gradient / (scale * scale);
        for i in 0..N {
            information[(i, i)] += if i < TURN { 1e-6 } else { 1e-3 };
        }
        // A drag that is known is held by a width of 10⁻⁷ 1/m.
        let drag = self.config.drag_sd_per_m().max(1e-7).powi(-2);
        information[(DRAG, DRAG)] += drag;
        gradient[DRAG] += drag * (state.drag_per_m - self.config.drag_per_m());
        let decay = self.config.spin_decay_sd_per_s().max(1e-7).powi(-2);
        information[(DECAY, DECAY)] += decay;
        gradient[DECAY] += decay * (state.decay_per_s - self.config.spin_decay_per_s());
        let spin = self.config.spin_prior_sd_radps.max(1e-6).powi(-2);
        for i in 0..3 {
            information[(SPIN + i, SPIN + i)] += spin;
            gradient[SPIN + i] += spin * state.w[i];
        }
        (information, gradient)
    }
}
