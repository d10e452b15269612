//! The flight that fits all poses best, by what each pose's information is worth.
//!
//! Minimizes Σ ρ(eᵢᵀ·Wᵢ·eᵢ / s²) + (k − k̄)²/σ_k² + |ω|²/σ_ω² + (c − c̄)²/σ_c² over (p, v, k, R, ω, c) at the
//! time of the newest pose, eᵢ being the turn and shift from the flight to pose i and Wᵢ its information, by
//! Gauss–Newton with reweighting. Of a round object ω is L/J_⊥, whose part along the axis is expected to be
//! J_∥/J_⊥ times as large. Outliers weigh nothing (ρ of Geman and McClure); the scale s, by which the poses
//! err more or less than they say, is estimated along.

mod row;
mod state;
mod sums;

use catch_body::{
    Pose,
    free_flight::{
        ballistic::{Law, Motion},
        tumbling::Tumbling,
    },
    symmetry::Symmetry,
};
use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

use super::{
    AerodynamicForces, Config, FIT_WINDOW, FlightTrajectory, PredictionStatus, WINDOW,
    agreement::{agrees, is_finite},
    correlated_error::CorrelatedSums,
    inertia_per_kg,
};
use crate::perception::ObjectPose;
use row::Row;
use state::{DECAY, N, ROTATION, State, TURN, solved};

/// Degrees of freedom that "the errors are as the poses say" counts for when their scale is estimated.
const SCALE_PRIOR_DOF: f64 = 12.0;
/// A fit has come to rest when a step is shorter than this fraction of its standard deviation.
const STEP_SD: f64 = 0.05;
/// Within this many standard deviations the flight is as good as linear in its parameters.
const LINEAR_SD: f64 = 0.5;

/// Iterations at most. A fit that has not come to rest by then counts if its poses err by no more than so
/// many times what they say.
const MAX_ITERATIONS: usize = 10;
const MOST_SCALE: f64 = 10.0;

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
    let freedom = match symmetry {
        Symmetry::Finite { .. } => 6.0,
        Symmetry::Axis { .. } => 5.0,
        Symmetry::Sphere => 3.0,
    };
    let (inertia, forces) = (inertia_per_kg(symmetry), start.forces);
    let problem = Problem { poses, newest_s, symmetry, inertia, forces, freedom, config };
    let (state, scale, agreeing) = problem.minimized(State::of(start, newest_s, config), scratch)?;
    let describe = if problem.turns() { Problem::flight::<N> } else { Problem::flight::<TURN> };
    let flight = describe(&problem, &state, scale, scratch);
    Ok((flight.ok_or(PredictionStatus::NotConverged)?, agreeing))
}

struct Problem<'a> {
    poses: &'a [ObjectPose],
    newest_s: f64,
    symmetry: &'a Symmetry,
    inertia: Option<Matrix3<f64>>,
    /// Forces of the flight from which the fit starts.
    forces: AerodynamicForces,
    freedom: f64,
    config: &'a Config,
}

impl Problem<'_> {
    /// Returns whether the object's orientation can be seen.
    fn turns(&self) -> bool {
        !matches!(self.symmetry, Symmetry::Sphere)
    }

    /// The state at the minimum, the scale of the errors, and how many of the newest poses agree with it.
    ///
    /// The poses near the start are taken for the good ones; how far the nearer half of as many is off sets
    /// the scale.
    fn minimized(&self, start: State, scratch: &mut Scratch) -> Result<(State, f64, usize), PredictionStatus> {
        let config = self.config;
        let mut state = start;
        let near_start = self.linearize(&state, self.poses.len(), scratch);
        let good = near_start.max(2);
        let mut scale = self.typical_error(good, scratch).max(1.0);
        let mut agreeing = near_start;
        for _ in 0..MAX_ITERATIONS {
            let sums = self.sums::<N>(scale, scale, None, scratch);
            let (information, gradient) = self.with_priors(&sums, &state, scale);
            let step = -solved(&information, &gradient, self.turns(), config).ok_or(PredictionStatus::NotConverged)?;
            if !step.iter().all(|value| value.is_finite()) {
                return Err(PredictionStatus::NotConverged);
            }
            let step_sd = step.dot(&(information * step)).sqrt();
            let before = state;
            state = state.moved(&step, config);
            agreeing = if step_sd < LINEAR_SD {
                self.advance(&state.since(&before), WINDOW, scratch)
            } else {
                self.linearize(&state, WINDOW, scratch)
            };
            let shrunk = self.typical_error(good, scratch).clamp(0.3, scale.max(1.0));
            let converged = step_sd < STEP_SD && shrunk > 0.7 * scale;
            scale = shrunk;
            if converged {
                return Ok((state, scale, agreeing));
            }
        }
        if scale > MOST_SCALE { Err(PredictionStatus::NotConverged) } else { Ok((state, scale, agreeing)) }
    }

    /// Flies from the newest pose to the oldest and notes how the flight stands to each. Returns how many of
    /// the newest `window` poses agree with it.
    fn linearize(&self, state: &State, window: usize, scratch: &mut Scratch) -> usize {
        scratch.rows.clear();
        // Room for as many poses as there will ever be, so that it is made once.
        scratch.rows.reserve(FIT_WINDOW);
        scratch.squares.reserve(FIT_WINDOW);
        let start = Tumbling::new(state.R_WO, &state.w, self.inertia.as_ref()).decaying(state.decay_per_s);
        // A decay that is known has no part in the fit.
        let decays = self.config.aerodynamics.spin_decay_sd_per_s > 0.0;
        let (mut motion, mut tumbling) = (Motion::new(state.p, state.v), start);
        let mut time_s = self.newest_s;
        let turns = self.turns();
        let force = |motion: &Motion, tumbling: &Tumbling| {
            self.forces.acceleration_mps2(&tumbling.R_WO, &motion.v, &tumbling.w_WO(), tumbling.left)
        };
        // Displacement of the object by the forces, and their part of its velocity.
        let (mut pushed_m, mut pushed_mps) = (Vector3::zeros(), Vector3::zeros());
        let mut agreeing = 0;
        for (age, pose) in self.poses.iter().rev().enumerate().filter(|(_, pose)| is_finite(pose)) {
            let elapsed_s = pose.capture_s - time_s;
            if elapsed_s != 0.0 {
                let before = (motion, tumbling);
                motion = motion.after(elapsed_s, &Law::with_drag(state.drag_per_m), true);
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
                shift: X_WO.translation.vector - motion.p - pushed_m,
                by_motion: motion.dp,
                shifts: pose.information.fixed_view::<3, 3>(3, 3).into_owned(),
                ..Row::default()
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
            agreeing += usize::from(age < window && agrees(pose, &row.shift));
            scratch.rows.push(row);
        }
        agreeing
    }

    /// The rows after a step that is short enough for their derivatives to hold. Returns how many of the
    /// newest `window` poses agree with the flight then.
    fn advance(&self, step: &SVector<f64, N>, window: usize, scratch: &mut Scratch) -> usize {
        let turns = self.turns();
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
            agreeing += usize::from(age < window && agrees(pose, &row.shift));
        }
        agreeing
    }

    /// Median of √(eᵀWe / degrees of freedom) over the `good` poses where it is smallest.
    fn typical_error(&self, good: usize, scratch: &mut Scratch) -> f64 {
        let Scratch { rows, squares } = scratch;
        squares.clear();
        squares.extend(rows.iter().map(|row| row.square / self.freedom));
        let middle = good.min(squares.len()) / 2;
        if squares.is_empty() { 1.0 } else { squares.select_nth_unstable_by(middle, f64::total_cmp).1.sqrt() }
    }

    /// The flight of a fitted state, with its covariance and the scale of the errors. Errors that poses have
    /// in common reach the first `M` parameters.
    fn flight<const M: usize>(&self, state: &State, scale: f64, scratch: &Scratch) -> Option<FlightTrajectory> {
        let mut correlated = CorrelatedSums::<M>::of(self.config.correlated_sd_per_m);
        let noisy = self.config.process_noise.any();
        let mut sums = self.sums(scale, scale, correlated.as_mut().filter(|_| !noisy), scratch);
        let error_scale = ((sums.squares + SCALE_PRIOR_DOF) / (sums.freedom + SCALE_PRIOR_DOF)).sqrt();
        if noisy {
            sums = self.sums(scale, error_scale, correlated.as_mut(), scratch);
        }
        let (information, _) = self.with_priors(&sums, state, error_scale);
        let mut covariance = solved::<N>(&information, &SMatrix::identity(), self.turns(), self.config)?;
        if let Some(correlated) = correlated {
            let mut first = covariance.fixed_view_mut::<M, M>(0, 0);
            first += correlated.covariance(&first.clone_owned()) / error_scale.powi(4);
        }
        Some(FlightTrajectory {
            time_s: self.newest_s,
            p_WOcm: Point3::from(state.p),
            v_WOcm: state.v,
            R_WO: state.R_WO,
            w_WO: state.w,
            drag_per_m: state.drag_per_m,
            spin_decay_per_s: state.decay_per_s,
            inertia_per_kg: self.inertia,
            covariance: covariance.fixed_view::<7, 7>(0, 0).into_owned(),
            rotation_covariance: covariance.fixed_view::<6, 6>(TURN, TURN).into_owned(),
            systematic_sd_m: self.config.systematic_sd_m,
            process_noise: self.config.process_noise,
            forces: self.forces,
            inliers: sums.inliers,
            considered: self.poses.len(),
            error_scale,
            ..FlightTrajectory::default()
        })
    }
}
