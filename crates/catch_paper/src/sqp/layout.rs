//! The variables of a motion's program, its constraints and its objective.

use catch_body::{JointVector, quadratic_program::ProgramFailure};
use catch_cell::spline::{DEGREE, basis};
use nalgebra::{DMatrix, DVector};

use super::interior_point::{Program, Row};
use super::problem::Problem;
use super::waypoint::{ERRORS, Linearized, Waypoint};

/// Price of an error, ρ: above any multiplier that was seen (about 1 per radian, metre or m/s).
pub(super) const PRICE: f64 = 30.0;
/// Weight of the distance from the comfortable pose, w. It makes the programs convex; any motion within the
/// tolerances will do, as in the code.
const COMFORT_WEIGHT: f64 = 1e-4;
/// Keeps the programs strictly convex in variables that nothing else weighs.
const DAMPING: f64 = 1e-7;
/// Distance from the limits that rounding needs, relative, and that the solver's tolerance needs, in radians.
const ROUNDING: f64 = 1e-7;
const SOLVED_RAD: f64 = 1e-8;

/// Order of the variables: joint by joint the control points that are free, then s, the stretch of the
/// duration if that is free, and the slacks of the errors.
pub(super) struct Layout {
    dof: usize,
    /// Bounds of the stretch, if it is free.
    pub stretch: Option<[f64; 2]>,
    /// Control points that are given.
    fixed: Vec<JointVector>,
    /// Control points that are free.
    free: usize,
    /// Basis functions at the waypoints: first index, values and first derivatives.
    at: Vec<(usize, [[f64; DEGREE + 1]; 3])>,
}

impl Layout {
    pub fn new(problem: &Problem) -> Self {
        let fixed = problem.fixed_points();
        Self {
            dof: problem.robot.dof(),
            stretch: Some(problem.stretch).filter(|[least, most]| least < most),
            free: problem.control_points() - fixed.len(),
            fixed,
            at: problem.waypoints.iter().map(|it| basis(&problem.knots_s, it.time_s)).collect(),
        }
    }

    pub fn fraction(&self) -> usize {
        self.dof * self.free
    }

    pub fn variables(&self) -> usize {
        self.fraction() + 1 + usize::from(self.stretch.is_some())
    }

    /// The variable of the stretch.
    fn stretch_variable(&self) -> usize {
        self.fraction() + 1
    }

    /// The factor by which the duration is longer than that of the knots.
    pub fn stretch_of(&self, x: &DVector<f64>) -> f64 {
        if self.stretch.is_some() { x[self.stretch_variable()] } else { 1.0 }
    }

    fn slacks(&self) -> usize {
        self.at.len() * ERRORS
    }

    /// The variable of control point `point` of a joint, if it is free.
    fn variable(&self, joint: usize, point: usize) -> Option<usize> {
        Some(joint * self.free + point.checked_sub(self.fixed.len())?)
    }

    pub fn control_points(&self, x: &DVector<f64>) -> Vec<JointVector> {
        let free = |k: usize| JointVector::from_fn(|j, _| if j < self.dof { x[j * self.free + k] } else { 0.0 });
        self.fixed.iter().copied().chain((0..self.free).map(free)).collect()
    }

    pub fn padded(&self, x: &DVector<f64>) -> DVector<f64> {
        DVector::from_fn(self.variables() + self.slacks(), |i, _| x.get(i).copied().unwrap_or(1e-2))
    }

    /// Rows that keep positions, velocities and accelerations within the limits; `None` if the start alone
    /// breaks one.
    ///
    /// Where t are the knots, the velocity has the control points Vᵢ = 3·(Pᵢ₊₁ − Pᵢ)/(tᵢ₊₄ − tᵢ₊₁), the
    /// acceleration Aᵢ = 2·(Vᵢ₊₁ − Vᵢ)/(tᵢ₊₄ − tᵢ₊₂), and each curve stays within the hull of its own (de
    /// Boor, ch. IX and X).
    pub fn limit_rows(&self, problem: &Problem) -> Option<Vec<Row>> {
        let (t, n) = (&problem.knots_s, self.fixed.len() + self.free);
        let velocity: Vec<Vec<f64>> = (0..n - 1)
            .map(|i| {
                let fraction = 3.0 / (t[i + 4] - t[i + 1]);
                let mut row = vec![0.0; n];
                (row[i], row[i + 1]) = (-fraction, fraction);
                row
            })
            .collect();
        let acceleration: Vec<Vec<f64>> = (0..n - 2)
            .map(|i| {
                let fraction = 2.0 / (t[i + 4] - t[i + 2]);
                (0..n).map(|k| (velocity[i + 1][k] - velocity[i][k]) * fraction).collect()
            })
            .collect();
        let mut rows = Vec::new();
        for (joint, limits) in problem.limits.iter().enumerate() {
            let inside = 1.0 - ROUNDING;
            for i in 0..self.free {
                let variable = joint * self.free + i;
                rows.push(Row { first: variable, a: vec![1.0], slack: None, bound: limits.upper });
                rows.push(Row { first: variable, a: vec![-1.0], slack: None, bound: -limits.lower });
            }
            for row in &velocity {
                self.add_limit(&mut rows, joint, row, limits.velocity * inside, self.stretch.is_some())?;
            }
            for row in acceleration.iter().filter(|_| limits.acceleration.is_finite()) {
                self.add_limit(&mut rows, joint, row, limits.acceleration * inside, false)?;
            }
        }
        if let Some([least, most]) = self.stretch {
            let first = self.stretch_variable();
            rows.push(Row { first, a: vec![1.0], slack: None, bound: most });
            rows.push(Row { first, a: vec![-1.0], slack: None, bound: -least });
        }
        Some(rows)
    }

    /// Two rows |Σ coefficientᵢ·Pᵢ| ≤ limit for one joint, scaled to a unit normal; none where nothing is
    /// free, and `None` where that alone is too much. Where it is one of the stretched motion, |Σ
    /// coefficientᵢ·Pᵢ| ≤ limit·stretch.
    fn add_limit(
        &self,
        rows: &mut Vec<Row>,
        joint: usize,
        coefficients: &[f64],
        limit: f64,
        is_stretched: bool,
    ) -> Option<()> {
        let given: f64 = coefficients.iter().zip(&self.fixed).map(|(fraction, point)| fraction * point[joint]).sum();
        let free = &coefficients[self.fixed.len()..];
        let Some(from) = free.iter().position(|it| *it != 0.0) else { return (given.abs() <= limit).then_some(()) };
        let until = free.iter().rposition(|it| *it != 0.0).unwrap_or(from) + 1;
        let slack = is_stretched.then(|| self.stretch_variable());
        // A row has its slack with a factor of one.
        let scale = if is_stretched {
            1.0 / limit
        } else {
            1.0 / free[from..until].iter().map(|it| it * it).sum::<f64>().sqrt()
        };
        for sign in [1.0, -1.0] {
            let a = free[from..until].iter().map(|it| sign * it * scale).collect();
            let bound = (if is_stretched { 0.0 } else { limit } - sign * given) * scale - SOLVED_RAD;
            rows.push(Row { first: joint * self.free + from, a, slack, bound });
        }
        Some(())
    }

    /// The motion within the limits that is nearest to a guess.
    pub fn feasible(
        &self,
        limits: &[Row],
        guess: &[JointVector],
        fraction: f64,
        stretch_guess: f64,
    ) -> Result<DVector<f64>, ProgramFailure> {
        let mut x = DVector::zeros(self.variables());
        for joint in 0..self.dof {
            for k in 0..self.free {
                x[joint * self.free + k] = guess[self.fixed.len() + k][joint];
            }
        }
        x[self.fraction()] = fraction;
        if let Some([least, most]) = self.stretch {
            x[self.stretch_variable()] = stretch_guess.clamp(least, most);
        }
        let hessian = DMatrix::identity(self.variables(), self.variables());
        Program { hessian, gradient: -&x, rows: limits.to_vec() }.minimize(x)
    }

    pub fn linearize(&self, problem: &Problem, x: &DVector<f64>) -> Vec<Linearized> {
        let points = self.control_points(x);
        let at = |(waypoint, (first, [value, rate, _])): (&Waypoint, &(usize, [[f64; 4]; 3]))| {
            let sum = |weights: &[f64]| {
                weights.iter().zip(&points[*first..]).map(|(weight, point)| point * *weight).sum::<JointVector>()
            };
            let (q, dq) = (sum(value), sum(rate) / self.stretch_of(x));
            waypoint.linearize(problem.robot, &q, &dq, x[self.fraction()]).aligned()
        };
        problem.waypoints.iter().zip(&self.at).map(at).collect()
    }

    /// Gradient of error `error` at waypoint `index`, around `x`.
    fn gradient(&self, x: &DVector<f64>, index: usize, at: &Linearized, error: usize) -> Vec<f64> {
        let (first, [value, rate, _]) = &self.at[index];
        let stretch = self.stretch_of(x);
        let mut a = vec![0.0; self.variables()];
        for joint in 0..self.dof {
            for k in 0..=DEGREE {
                if let Some(variable) = self.variable(joint, first + k) {
                    a[variable] = at.by_q[(error, joint)] * value[k] + at.by_dq[(error, joint)] * rate[k] / stretch;
                }
            }
        }
        a[self.fraction()] = at.by_fraction[error];
        if self.stretch.is_some() {
            // The velocity is inversely proportional to it.
            let points = self.control_points(x);
            let dq: JointVector =
                rate.iter().zip(&points[*first..]).map(|(weight, point)| point * *weight).sum::<JointVector>()
                    / stretch;
            a[self.stretch_variable()] = -(at.by_dq.row(error) * dq)[0] / stretch;
        }
        a
    }

    /// The quadratic program around `x`.
    pub fn program(
        &self,
        problem: &Problem,
        limits: &[Row],
        x: &DVector<f64>,
        now: &[Linearized],
        radius: f64,
    ) -> Program {
        let size = self.variables() + self.slacks();
        let mut hessian = DMatrix::from_diagonal_element(size, size, DAMPING);
        let mut gradient = DVector::zeros(size);
        for joint in 0..self.dof {
            for k in 0..self.free {
                let variable = joint * self.free + k;
                hessian[(variable, variable)] += COMFORT_WEIGHT;
                let wanted = problem.comfortable_q.map_or(x[variable], |it| it[joint]);
                gradient[variable] = -COMFORT_WEIGHT * wanted;
            }
        }
        if self.stretch.is_some() {
            let variable = self.stretch_variable();
            hessian[(variable, variable)] += COMFORT_WEIGHT;
            gradient[variable] = -COMFORT_WEIGHT * x[variable];
        }
        let mut rows = limits.to_vec();
        // An interior is needed, even of one number.
        let (fraction, room) = (problem.speed_fraction, 1e-9);
        for (sign, bound) in [(1.0, fraction + room), (-1.0, room - fraction)] {
            rows.push(Row { first: self.fraction(), a: vec![sign], slack: None, bound });
        }
        // The trust region: a joint's position control points have rows of their own already, which it can
        // only tighten.
        for variable in 0..self.fraction() {
            for sign in [1.0, -1.0] {
                rows.push(Row { first: variable, a: vec![sign], slack: None, bound: radius + sign * x[variable] });
            }
        }
        for (index, (at, waypoint)) in now.iter().zip(&problem.waypoints).enumerate() {
            for error in (0..ERRORS).filter(|error| waypoint.tolerance.of(*error).is_finite()) {
                let slack = self.variables() + index * ERRORS + error;
                gradient[slack] = PRICE;
                rows.push(Row { first: 0, a: vec![0.0], slack: Some(slack), bound: 0.0 });
                let a = self.gradient(x, index, at, error);
                let offset: f64 = at.error[error] - a.iter().zip(x.iter()).map(|(a, x)| a * x).sum::<f64>();
                for sign in [1.0, -1.0] {
                    let bound = waypoint.tolerance.of(error) - sign * offset;
                    let a = a.iter().map(|it| sign * it).collect();
                    rows.push(Row { first: 0, a, slack: Some(slack), bound });
                }
            }
        }
        Program { hessian, gradient, rows }
    }

    pub fn objective(&self, problem: &Problem, x: &DVector<f64>) -> f64 {
        let far: f64 = problem.comfortable_q.map_or(0.0, |comfortable_q| {
            let distance = |(i, x): (usize, &f64)| (x - comfortable_q[i / self.free]).powi(2);
            x.iter().enumerate().take(self.fraction()).map(distance).sum()
        });
        0.5 * COMFORT_WEIGHT * far
    }

    /// Sum of what the errors exceed their tolerances by, here or, by the linearization, a step away from
    /// here.
    pub fn violation(
        &self,
        problem: &Problem,
        now: &[Linearized],
        step: Option<(&DVector<f64>, &DVector<f64>)>,
    ) -> f64 {
        let mut sum = 0.0;
        for (index, (at, waypoint)) in now.iter().zip(&problem.waypoints).enumerate() {
            for error in 0..ERRORS {
                let change = step.map_or(0.0, |(x, step)| {
                    self.gradient(x, index, at, error).iter().zip(step.iter()).map(|(a, step)| a * step).sum()
                });
                sum += ((at.error[error] + change).abs() - waypoint.tolerance.of(error)).max(0.0);
            }
        }
        sum
    }

    /// Excess of the worst error over its tolerance.
    pub fn excess(&self, problem: &Problem, now: &[Linearized]) -> f64 {
        now.iter().zip(&problem.waypoints).map(|(at, waypoint)| waypoint.excess(at)).fold(0.0, f64::max)
    }
}
