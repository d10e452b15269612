//! Iterated extended Kalman smoother: Gauss–Newton on the posterior of the motion and the parameters (Bell, 1994).
//!
//! Each pass linearizes about the motion of the pass before, filters forward, and smooths backward by the adjoint recursion
//! of Bryson and Frazier, which inverts nothing but the 6×6 covariance of an innovation. Outliers are weighed down as errors of
//! Student's t distribution: w = (ν + 3)/(ν + |e|²/σ²).

use nalgebra::{Matrix6, SMatrix, UnitQuaternion, Vector3, Vector6};

use super::{
    FlightPrior, Noise, ParameterCovariance,
    dynamics::{
        Body, Covariance, ErrorState, N, OMEGA, PARAMETERS, POINT, ParameterVector, State, THETA, Transition, V,
    },
};
use crate::statistics::median_in_place;

/// Degrees of freedom of the errors' distribution.
const STUDENT_DOF: f64 = 4.0;
/// Longest step of the integration.
pub(super) const STEP_S: f64 = 0.01;
/// Most steps between two times.
const MAX_STEPS: f64 = 1000.0;
/// Largest element of S that is believed: a ratio of inertias of fifty.
const MAX_SHAPE: f64 = 2.0;
/// The median of the norm of three standard normal numbers.
const MEDIAN: f64 = 1.538;

/// What was measured at one time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub time_s: f64,
    pub p: Vector3<f64>,
    pub R: Option<UnitQuaternion<f64>>,
}

/// The motion at one sample, and what the backward recursion needs of the forward one.
#[derive(Debug, Clone)]
pub(super) struct Node {
    pub state: State,
    pub weight_p: f64,
    pub weight_R: f64,
    /// Errors of position and orientation of the smoothed motion.
    pub error_m: f64,
    pub error_rad: f64,
    filtered: ErrorState,
    covariance: Covariance,
    transition: Transition,
    by: SMatrix<f64, 6, N>,
    gain: SMatrix<f64, N, 6>,
    /// Inverse covariance of the innovation, times the innovation.
    scaled: Vector6<f64>,
    smoothed: ErrorState,
}

impl Node {
    pub fn new() -> Self {
        Self {
            state: State::origin(),
            weight_p: 1.0,
            weight_R: 1.0,
            error_m: 0.0,
            error_rad: 0.0,
            filtered: ErrorState::zeros(),
            covariance: Covariance::zeros(),
            transition: Transition::zeros(),
            by: SMatrix::zeros(),
            gain: SMatrix::zeros(),
            scaled: Vector6::zeros(),
            smoothed: ErrorState::zeros(),
        }
    }
}

/// What is smoothed.
pub(super) struct Problem<'a> {
    pub g: Vector3<f64>,
    pub prior: &'a FlightPrior,
    pub samples: &'a [Sample],
    /// Whether orientations were measured; without them the body frame is the world's and does not rotate.
    pub oriented: bool,
}

/// Standard deviations of the first state before anything is seen: so large that they do not matter.
const FIRST_SD: [(usize, f64); 4] = [(0, 10.0), (V, 100.0), (THETA, 10.0), (OMEGA, 300.0)];

impl Problem<'_> {
    /// Mean and covariance of the parameters before anything is seen.
    ///
    /// Without orientations the tracked point cannot be told from the centre of mass, and of the drag only what is left on
    /// average over all orientations: a third of the matrix's trace along each axis.
    fn moments(&self) -> (ParameterVector, ParameterCovariance) {
        let (mean, covariance) = (self.prior.mean(), self.prior.covariance());
        if self.oriented {
            return (mean, covariance);
        }
        let (mut isotropic, mut shared) = (ParameterVector::zeros(), ParameterCovariance::zeros());
        isotropic.fixed_rows_mut::<3>(3).fill(mean.fixed_rows::<3>(3).mean());
        shared.fixed_view_mut::<3, 3>(3, 3).fill(covariance.fixed_view::<3, 3>(3, 3).sum() / 9.0);
        (isotropic, shared)
    }

    /// The body as the prior has it.
    pub fn body(&self) -> Body {
        Body::new(&self.moments().0)
    }

    /// One pass; returns the largest step in units of the posterior's standard deviations at the last sample.
    pub fn pass(&self, body: &mut Body, nodes: &mut [Node], noise: &Noise) -> Option<f64> {
        self.filter(body, nodes, noise)?;
        let last = nodes.len() - 1;
        smooth(nodes);
        let step = nodes[last].filtered;
        let spread = nodes[last].covariance.diagonal();
        let size = step.iter().zip(&spread).map(|(step, variance)| step.abs() / variance.max(1e-18).sqrt());
        let size = size.fold(0.0, f64::max);
        let mut parameters = body.parameters + step.fixed_rows::<PARAMETERS>(POINT);
        for element in parameters.iter_mut().skip(11) {
            *element = element.clamp(-MAX_SHAPE, MAX_SHAPE);
        }
        *body = Body::new(&parameters);
        for node in nodes.iter_mut() {
            node.state = node.state.moved(&node.smoothed);
        }
        (size.is_finite() && parameters.iter().all(|it| it.is_finite())).then_some(size)
    }

    fn filter(&self, body: &Body, nodes: &mut [Node], noise: &Noise) -> Option<()> {
        let mut mean = ErrorState::zeros();
        let mut covariance = Covariance::zeros();
        for (first, sd) in FIRST_SD {
            let fixed = !self.oriented && first >= THETA;
            (first..first + 3).for_each(|i| covariance[(i, i)] = if fixed { 0.0 } else { sd * sd });
        }
        let (prior, parameters) = self.moments();
        mean.fixed_rows_mut::<PARAMETERS>(POINT).copy_from(&(prior - body.parameters));
        covariance.fixed_view_mut::<PARAMETERS, PARAMETERS>(POINT, POINT).copy_from(&parameters);
        for k in 0..nodes.len() {
            if k > 0 {
                let duration_s = self.samples[k].time_s - self.samples[k - 1].time_s;
                let (next, transition) = propagate(body, &self.g, &nodes[k - 1].state, duration_s);
                let carried = transition * mean + next.since(&nodes[k].state);
                mean.fixed_rows_mut::<12>(0).copy_from(&carried);
                self.carry(&transition, &mut covariance, duration_s);
                nodes[k].transition = transition;
            }
            self.update(body, &self.samples[k], &mut nodes[k], (&mut mean, &mut covariance), noise)?;
        }
        Some(())
    }

    /// C → F·C·Fᵀ + Q.
    pub fn carry(&self, transition: &Transition, covariance: &mut Covariance, duration_s: f64) {
        let product = transition * *covariance;
        let own = product * transition.transpose();
        let mixed = product.fixed_columns::<PARAMETERS>(POINT).into_owned();
        covariance.fixed_view_mut::<12, 12>(0, 0).copy_from(&own);
        covariance.fixed_view_mut::<12, PARAMETERS>(0, POINT).copy_from(&mixed);
        covariance.fixed_view_mut::<PARAMETERS, 12>(POINT, 0).copy_from(&mixed.transpose());
        let mut add = |at: usize, density: f64| {
            let (t, q) = (duration_s.abs(), density * density);
            for i in at..at + 3 {
                covariance[(i, i)] += q * t.powi(3) / 3.0;
                covariance[(i, i + 3)] += q * t * t / 2.0;
                covariance[(i + 3, i)] += q * t * t / 2.0;
                covariance[(i + 3, i + 3)] += q * t;
            }
        };
        add(0, self.prior.acceleration_noise);
        if self.oriented {
            add(THETA, self.prior.angular_acceleration_noise);
        }
    }

    fn update(
        &self,
        body: &Body,
        sample: &Sample,
        node: &mut Node,
        (mean, covariance): (&mut ErrorState, &mut Covariance),
        noise: &Noise,
    ) -> Option<()> {
        let R = node.state.R.to_rotation_matrix().into_inner();
        let mut by = SMatrix::<f64, 6, N>::zeros();
        by.fixed_view_mut::<3, N>(0, 0).copy_from(&node.state.tracked_point_by(body).fixed_rows::<3>(0));
        by.fixed_view_mut::<3, 3>(3, THETA).fill_with_identity();
        let turn = sample.R.map_or_else(Vector3::zeros, |it| (node.state.R.inverse() * it).scaled_axis());
        let mut error = Vector6::zeros();
        error.fixed_rows_mut::<3>(0).copy_from(&(sample.p - node.state.p - R * body.r));
        error.fixed_rows_mut::<3>(3).copy_from(&turn);
        let innovation = error - by * *mean;
        let product = *covariance * by.transpose();
        let mut spread = by * product;
        let variance = |sd: f64, weight: f64| sd * sd / weight.max(1e-12);
        for i in 0..3 {
            spread[(i, i)] += variance(noise.position_sd_m, node.weight_p);
            spread[(i + 3, i + 3)] +=
                if sample.R.is_some() { variance(noise.orientation_sd_rad, node.weight_R) } else { 1e12 };
        }
        let inverse: Matrix6<f64> = spread.cholesky()?.inverse();
        node.by = by;
        node.gain = product * inverse;
        node.scaled = inverse * innovation;
        *mean += node.gain * innovation;
        *covariance -= node.gain * product.transpose();
        *covariance = (*covariance + covariance.transpose()) * 0.5;
        node.filtered = *mean;
        node.covariance = *covariance;
        Some(())
    }

    /// Errors of the smoothed motion, and weights by them.
    pub fn weigh(&self, body: &Body, nodes: &mut [Node], noise: &Noise) {
        let weight = |error: f64, sd: f64| (STUDENT_DOF + 3.0) / (STUDENT_DOF + (error / sd).powi(2));
        for (node, sample) in nodes.iter_mut().zip(self.samples) {
            node.error_m = (sample.p - node.state.tracked_point(body).0).norm();
            node.weight_p = weight(node.error_m, noise.position_sd_m);
            if let Some(R) = sample.R {
                node.error_rad = R.angle_to(&node.state.R);
                node.weight_R = weight(node.error_rad, noise.orientation_sd_rad);
            }
        }
    }

    /// Noise of the samples by the median of their errors.
    pub fn noise(&self, nodes: &[Node], buffer: &mut Vec<f64>) -> Noise {
        let mut typical = |error: &dyn Fn(&Node) -> f64| {
            buffer.clear();
            buffer.extend(nodes.iter().map(error));
            median_in_place(buffer) / MEDIAN
        };
        Noise {
            position_sd_m: typical(&|node| node.error_m).max(self.prior.least_noise.position_sd_m),
            orientation_sd_rad: typical(&|node| node.error_rad).max(self.prior.least_noise.orientation_sd_rad),
        }
    }
}

impl Node {
    /// Covariance of the error state given all samples up to this one.
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }
}

/// The state some time later (or earlier, if negative) and its derivatives, in steps short enough.
pub(super) fn propagate(body: &Body, g: &Vector3<f64>, from: &State, duration_s: f64) -> (State, Transition) {
    let steps = (duration_s.abs() / STEP_S - 1e-6).ceil().clamp(1.0, MAX_STEPS);
    let h = duration_s / steps;
    let (mut state, mut transition) = body.step_with_derivatives(g, from, h);
    for _ in 1..steps as usize {
        let (next, by) = body.step_with_derivatives(g, &state, h);
        let mut whole = by.fixed_columns::<12>(0) * transition;
        let mut rest = whole.fixed_columns_mut::<PARAMETERS>(POINT);
        rest += by.fixed_columns::<PARAMETERS>(POINT);
        (state, transition) = (next, whole);
    }
    (state, transition)
}

/// λ̃ₖ = −Hᵀ·S⁻¹·y + (1 − K·H)ᵀ·λₖ, λₖ₋₁ = Fₖᵀ·λ̃ₖ; the smoothed mean is that filtered less C·λₖ.
fn smooth(nodes: &mut [Node]) {
    let mut adjoint = ErrorState::zeros();
    for k in (0..nodes.len()).rev() {
        let node = &mut nodes[k];
        node.smoothed = node.filtered - node.covariance * adjoint;
        // (1 − K·H)ᵀ·λ − Hᵀ·S⁻¹·y = λ − Hᵀ·(Kᵀ·λ + S⁻¹·y)
        let back = node.gain.transpose() * adjoint + node.scaled;
        adjoint -= node.by.transpose() * back;
        if k > 0 {
            let own = adjoint.fixed_rows::<12>(0).into_owned();
            let mut carried = nodes[k].transition.transpose() * own;
            let mut rest = carried.fixed_rows_mut::<PARAMETERS>(POINT);
            rest += adjoint.fixed_rows::<PARAMETERS>(POINT);
            adjoint = carried;
        }
    }
}
