//! The general, nonlinear form of the paper's trajectory optimization (III-D): all joints' control points at once.
//!
//! ```text
//!     min   ½w·Σ|Pᵢ − q₀|² − κ·s + ρ·Σ max(0, |e| − tolerance)
//!     P, s
//!     s.t.  q(0), q̇(0), q̈(0) as they are,   position, velocity and acceleration limits on control points,   s within its range
//! ```
//! P are the control points of a cubic B-spline, s the fraction of the object's velocity at which the gripper moves along, e the
//! errors at the waypoints ([`Waypoint`]): pose of the gripper and velocity of one of its points. The arm may have any
//! kinematics; no closed form is asked for. What the closed forms of [`MotionPlanner`](catch_bot::trajectory_optimization::MotionPlanner) solve exactly and faster, this
//! solves for everything else.
//!
//! Sequential quadratic programming with an exact penalty in a trust region (Fletcher, Practical Methods of Optimization, section
//! 14.4, Sℓ₁QP): the limits are linear in P and kept by every iterate, the errors are linearized and may be broken at a price.
//! So what comes out never breaks a limit, and where the waypoints cannot be met it comes as close as it can.

pub mod interior_point;
mod problem;
pub mod waypoint;

use catch_body::JointVector;
use catch_bot::trajectory_optimization::quadratic_program::ProgramFailure;
use catch_cell::{
    BSpline,
    arm::Setpoint,
    spline::{DEGREE, basis},
};
use nalgebra::{DMatrix, DVector};

use interior_point::{Program, Row};
pub use problem::{Problem, Solution, StartState};
use waypoint::{ERRORS, Linearized};
pub use waypoint::{Tolerance, Waypoint};

/// Price of an error, ρ: above any multiplier that was seen (about 1 per radian, metre or m/s).
const PRICE: f64 = 30.0;
/// Quadratic programs at most.
const ITERATIONS: usize = 25;
/// Trust region at the start, in radians, and the smallest that is worth a step.
const RADIUS: f64 = 0.5;
const LEAST_RADIUS: f64 = 1e-9;
/// Corrections at most once the objective has converged or time is up, of what excess, and in what trust region, relative to it.
const CORRECTIONS: usize = 3;
const CORRECTABLE: f64 = 1e-4;
const CORRECTION_RADIUS: f64 = 100.0;
/// An excess below this is none.
pub const MET: f64 = 1e-8;
/// A model that promises to gain less than this, relative, has converged: where the waypoints are met, and where not.
const CONVERGED: f64 = 1e-5;
const LEAST_GAIN: f64 = 1e-9;
/// Keeps the programs strictly convex in variables that nothing else weighs.
const DAMPING: f64 = 1e-7;
/// Distance from the limits that rounding needs, relative, and that the solver's tolerance needs, in radians.
const ROUNDING: f64 = 1e-7;
const SOLVED_RAD: f64 = 1e-8;

impl Problem<'_> {
    /// Number of control points.
    pub fn control_points(&self) -> usize {
        self.knots_s.len() - DEGREE - 1
    }

    /// The motion, sought from a guess of its control points.
    ///
    /// # Errors
    /// If no motion from this start keeps the limits, or none was found that does.
    pub fn solve(&self, guess: &[JointVector]) -> Result<Solution, ProgramFailure> {
        let layout = Layout::new(self);
        let limits = layout.limit_rows(self).ok_or(ProgramFailure::Infeasible)?;
        let mut x = layout.feasible(&limits, guess, self.speed_fraction[1])?;
        let mut now = layout.linearize(self, &x);
        let mut radius = RADIUS;
        let mut iterations = 0;
        while iterations < ITERATIONS && radius > LEAST_RADIUS {
            if self.first_will_do && layout.excess(self, &now) < MET {
                break;
            }
            iterations += 1;
            let Ok(candidate) = layout.program(self, &limits, &x, &now, radius).minimize(layout.padded(&x)) else {
                radius *= 0.25;
                continue;
            };
            let candidate = candidate.rows(0, layout.variables()).into_owned();
            let step = &candidate - &x;
            let merit = layout.objective(self, &x) + PRICE * layout.violation(self, &now, None);
            let promised =
                merit - layout.objective(self, &candidate) - PRICE * layout.violation(self, &now, Some((&x, &step)));
            let enough = if layout.excess(self, &now) < MET { CONVERGED } else { LEAST_GAIN };
            if promised < enough * (1.0 + merit.abs()) {
                break;
            }
            let next = layout.linearize(self, &candidate);
            let violation = layout.violation(self, &next, None);
            let gained = merit - layout.objective(self, &candidate) - PRICE * violation;
            // Near the end the linearization's error hides what the objective gains; a violation that halves is progress, too.
            let halves = violation < 0.5 * layout.violation(self, &now, None);
            if gained > 0.1 * promised || halves {
                if gained > 0.7 * promised && step.amax() > 0.9 * radius {
                    radius *= 2.0;
                }
                (x, now) = (candidate, next);
            } else {
                radius = 0.3 * step.amax().min(radius);
            }
        }
        let converged = iterations < ITERATIONS;
        // Steps along a curved constraint leave behind what its curvature costs (Maratos 1978); short ones take it away.
        let most = iterations + CORRECTIONS;
        while iterations < most && (MET..CORRECTABLE).contains(&layout.excess(self, &now)) {
            iterations += 1;
            let radius = CORRECTION_RADIUS * layout.excess(self, &now);
            let found = layout.program(self, &limits, &x, &now, radius).minimize(layout.padded(&x));
            let Ok(candidate) = found.map(|it| it.rows(0, layout.variables()).into_owned()) else { break };
            let next = layout.linearize(self, &candidate);
            if layout.excess(self, &next) < layout.excess(self, &now) {
                (x, now) = (candidate, next);
            }
        }
        let (start_s, stretch) = (self.knots_s[0], layout.stretch_of(&x));
        let knots_s = self.knots_s.iter().map(|knot_s| start_s + (knot_s - start_s) * stretch).collect();
        let knots_s = if layout.stretch.is_some() { knots_s } else { self.knots_s.clone() };
        let spline = BSpline { knots_s, control_points: layout.control_points(&x) };
        let (speed_fraction, excess) = (x[layout.fraction()], layout.excess(self, &now));
        Ok(Solution { spline, speed_fraction, excess, iterations, converged })
    }

    /// By how much the worst error of some motion exceeds its tolerance.
    pub fn excess_of(&self, motion: impl Fn(f64) -> Setpoint, fraction: f64) -> f64 {
        let of_waypoint = |waypoint: &Waypoint| {
            let at = motion(waypoint.time_s);
            waypoint.excess(&waypoint.linearize(self.robot, &at.q, &at.dq, fraction))
        };
        self.waypoints.iter().map(of_waypoint).fold(0.0, f64::max)
    }

    /// The first control points, which the start leaves no choice about.
    ///
    /// P₀ = q, P₁ = q + q̇·h₁/3, and P₂ from q̈ = 2·(V₁ − V₀)/h₁ with V the control points of the velocity, h₁ being the first
    /// span.
    fn fixed_points(&self) -> Vec<JointVector> {
        if self.keeps_start == StartState::Nothing {
            return Vec::new();
        }
        let t = &self.knots_s;
        let first_span = t[DEGREE + 1] - t[1];
        let mut points = vec![self.start.q, self.start.q + self.start.dq * (first_span / 3.0)];
        if self.keeps_start == StartState::Acceleration {
            let V1 = self.start.dq + self.start.ddq * (first_span / 2.0);
            points.push(points[1] + V1 * ((t[DEGREE + 2] - t[2]) / 3.0));
        }
        points
    }
}

/// Which variable is which: joint by joint the control points that are free, then s, the stretch of the duration if that is free,
/// and the slacks of the errors.
struct Layout {
    dof: usize,
    /// Bounds of the stretch, if it is free.
    stretch: Option<[f64; 2]>,
    /// Control points that are given.
    fixed: Vec<JointVector>,
    /// Control points that are free.
    free: usize,
    /// Basis functions at the waypoints: first index, values and first derivatives.
    at: Vec<(usize, [[f64; DEGREE + 1]; 3])>,
}

impl Layout {
    fn new(problem: &Problem) -> Self {
        let fixed = problem.fixed_points();
        Self {
            dof: problem.robot.dof(),
            stretch: Some(problem.stretch).filter(|[least, most]| least < most),
            free: problem.control_points() - fixed.len(),
            fixed,
            at: problem.waypoints.iter().map(|it| basis(&problem.knots_s, it.time_s)).collect(),
        }
    }

    fn fraction(&self) -> usize {
        self.dof * self.free
    }

    fn variables(&self) -> usize {
        self.fraction() + 1 + usize::from(self.stretch.is_some())
    }

    /// The variable of the stretch.
    fn stretch_variable(&self) -> usize {
        self.fraction() + 1
    }

    /// The factor by which the duration is longer than that of the knots.
    fn stretch_of(&self, x: &DVector<f64>) -> f64 {
        if self.stretch.is_some() { x[self.stretch_variable()] } else { 1.0 }
    }

    fn slacks(&self) -> usize {
        self.at.len() * ERRORS
    }

    /// The variable of control point `point` of a joint, if it is free.
    fn variable(&self, joint: usize, point: usize) -> Option<usize> {
        Some(joint * self.free + point.checked_sub(self.fixed.len())?)
    }

    fn control_points(&self, x: &DVector<f64>) -> Vec<JointVector> {
        let free = |k: usize| JointVector::from_fn(|j, _| if j < self.dof { x[j * self.free + k] } else { 0.0 });
        self.fixed.iter().copied().chain((0..self.free).map(free)).collect()
    }

    fn padded(&self, x: &DVector<f64>) -> DVector<f64> {
        DVector::from_fn(self.variables() + self.slacks(), |i, _| x.get(i).copied().unwrap_or(1e-2))
    }

    /// Rows that keep positions, velocities and accelerations within the limits; `None` if the start alone breaks one.
    ///
    /// Where t are the knots, the velocity has the control points Vᵢ = 3·(Pᵢ₊₁ − Pᵢ)/(tᵢ₊₄ − tᵢ₊₁), the acceleration
    /// Aᵢ = 2·(Vᵢ₊₁ − Vᵢ)/(tᵢ₊₄ − tᵢ₊₂), and each curve stays within the hull of its own (de Boor, ch. IX and X).
    fn limit_rows(&self, problem: &Problem) -> Option<Vec<Row>> {
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

    /// Two rows |Σ coefficientᵢ·Pᵢ| ≤ limit for one joint, scaled to a unit normal; none where nothing is free, and
    /// `None` where that alone is too much. Where it is one of the stretched motion, |Σ coefficientᵢ·Pᵢ| ≤ limit·stretch.
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
    fn feasible(&self, limits: &[Row], guess: &[JointVector], fraction: f64) -> Result<DVector<f64>, ProgramFailure> {
        let mut x = DVector::zeros(self.variables());
        for joint in 0..self.dof {
            for k in 0..self.free {
                x[joint * self.free + k] = guess[self.fixed.len() + k][joint];
            }
        }
        x[self.fraction()] = fraction;
        if self.stretch.is_some() {
            x[self.stretch_variable()] = 1.0;
        }
        let hessian = DMatrix::identity(self.variables(), self.variables());
        Program { hessian, gradient: -&x, rows: limits.to_vec() }.minimize(x)
    }

    fn linearize(&self, problem: &Problem, x: &DVector<f64>) -> Vec<Linearized> {
        let points = self.control_points(x);
        let at = |(waypoint, (first, [value, rate, _])): (&Waypoint, &(usize, [[f64; 4]; 3]))| {
            let sum = |weights: &[f64]| {
                weights.iter().zip(&points[*first..]).map(|(weight, point)| point * *weight).sum::<JointVector>()
            };
            waypoint.linearize(problem.robot, &sum(value), &(sum(rate) / self.stretch_of(x)), x[self.fraction()])
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
    fn program(&self, problem: &Problem, limits: &[Row], x: &DVector<f64>, now: &[Linearized], radius: f64) -> Program {
        let size = self.variables() + self.slacks();
        let mut hessian = DMatrix::from_diagonal_element(size, size, DAMPING);
        let mut gradient = DVector::zeros(size);
        for joint in 0..self.dof {
            for k in 0..self.free {
                let variable = joint * self.free + k;
                hessian[(variable, variable)] += problem.comfort_weight;
                let wanted = problem.comfortable_q.map_or(x[variable], |it| it[joint]);
                gradient[variable] = -problem.comfort_weight * wanted;
            }
        }
        if self.stretch.is_some() {
            let variable = self.stretch_variable();
            hessian[(variable, variable)] += problem.comfort_weight;
            gradient[variable] = -problem.comfort_weight * x[variable];
        }
        gradient[self.fraction()] = -problem.speed_weight;
        let mut rows = limits.to_vec();
        let [low, high] = problem.speed_fraction;
        // An interior is needed, even of a range that is one number.
        let room = if high - low < 1e-6 { 1e-9 } else { 0.0 };
        for (sign, bound) in [(1.0, high + room), (-1.0, room - low)] {
            rows.push(Row { first: self.fraction(), a: vec![sign], slack: None, bound });
        }
        // The trust region: a joint's position control points have rows of their own already, which it can only tighten.
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

    fn objective(&self, problem: &Problem, x: &DVector<f64>) -> f64 {
        let far: f64 = problem.comfortable_q.map_or(0.0, |comfortable_q| {
            let distance = |(i, x): (usize, &f64)| (x - comfortable_q[i / self.free]).powi(2);
            x.iter().enumerate().take(self.fraction()).map(distance).sum()
        });
        0.5 * problem.comfort_weight * far - problem.speed_weight * x[self.fraction()]
    }

    /// Sum of what the errors exceed their tolerances by, here or, by the linearization, a step away from here.
    fn violation(&self, problem: &Problem, now: &[Linearized], step: Option<(&DVector<f64>, &DVector<f64>)>) -> f64 {
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

    /// What the worst error exceeds its tolerance by.
    fn excess(&self, problem: &Problem, now: &[Linearized]) -> f64 {
        now.iter().zip(&problem.waypoints).map(|(at, waypoint)| waypoint.excess(at)).fold(0.0, f64::max)
    }
}

/// Knots of a motion with `points` control points and equal spans.
pub fn clamped_knots(start_s: f64, end_s: f64, points: usize) -> Vec<f64> {
    let spans = points - DEGREE;
    let inner = (1..spans).map(|i| start_s + (end_s - start_s) * i as f64 / spans as f64);
    [start_s; DEGREE + 1].into_iter().chain(inner).chain([end_s; DEGREE + 1]).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use catch_body::{Robot, robot::JointLimits, robot_file::RobotFiles};
    use nalgebra::{Point3, Vector3};
    use proptest::prelude::*;

    pub fn iiwa() -> Robot {
        Robot::from_files(&RobotFiles {
            urdf_file: "robot.urdf",
            urdf: include_str!("../../../assets/robots/iiwa14/robot.urdf"),
            toml_file: "robot.toml",
            toml: include_str!("../../../assets/robots/iiwa14/robot.toml"),
        })
        .unwrap()
    }

    /// A catch that is reached by construction: the end of a motion of 0.5 s that uses half of what the joints can do.
    fn problem<'a>(robot: &'a Robot, toward: &JointVector) -> Problem<'a> {
        let start = Setpoint::at_rest(robot.ready_q);
        let limits: Vec<JointLimits> = robot.joints.iter().map(|joint| joint.limits).collect();
        let q = JointVector::from_fn(|i, _| {
            let Some(limits) = limits.get(i) else { return 0.0 };
            let by = 0.5 * (limits.acceleration * 0.5 * 0.5 / 4.0).min(limits.velocity * 0.25);
            (start.q[i] + toward[i] * by).clamp(limits.lower + 0.1, limits.upper - 0.1)
        });
        let waypoint = Waypoint {
            time_s: 0.5,
            X_WG: robot.gripper_pose(&q),
            v_WO: Vector3::new(-1.5, -2.5, -3.0),
            p_GP: Point3::new(0.0, 0.0833, 0.0),
            fraction: None,
            tolerance: Tolerance::NONE,
        };
        Problem {
            robot,
            knots_s: clamped_knots(0.0, 0.5, 8),
            start,
            keeps_start: StartState::Acceleration,
            stretch: [1.0; 2],
            limits,
            waypoints: vec![waypoint],
            speed_fraction: [0.0, 0.3],
            comfortable_q: Some(robot.comfortable_q),
            comfort_weight: 0.01,
            speed_weight: 1.0,
            first_will_do: false,
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// What starts, ends and moves as it should keeps every limit, whether or not it gets there; nearly all get there.
        #[test]
        fn limits_hold_and_the_start_is_exact(toward in prop::array::uniform7(-1.0f64..1.0)) {
            let robot = iiwa();
            let problem = problem(&robot, &robot.joint_vector(&toward).unwrap());
            let guess = vec![problem.start.q; 8];
            let found = problem.solve(&guess).unwrap();
            let [q, dq, ddq] = found.spline.evaluate(0.0);
            prop_assert!((q - problem.start.q).amax() < 1e-12);
            prop_assert!(dq.amax() < 1e-10 && ddq.amax() < 1e-9);
            for i in 0..=200 {
                let [q, dq, ddq] = found.spline.evaluate(0.5 * f64::from(i) / 200.0);
                for (j, limits) in problem.limits.iter().enumerate() {
                    prop_assert!(q[j] <= limits.upper + 1e-8 && q[j] >= limits.lower - 1e-8);
                    prop_assert!(dq[j].abs() <= limits.velocity);
                    prop_assert!(ddq[j].abs() <= limits.acceleration);
                }
            }
            prop_assert!(found.excess < MET, "{} after {} programs", found.excess, found.iterations);
        }
    }

    /// Joints that are free at the start, a duration within bounds, no limit of acceleration: as in the authors' code.
    #[test]
    fn a_start_within_tolerances_leaves_the_joints_free() {
        let robot = iiwa();
        let mut problem = problem(&robot, &JointVector::from_fn(|i, _| if i < 7 { 0.6 } else { 0.0 }));
        let X_WG = robot.gripper_pose(&problem.start.q);
        let tolerance = Tolerance { position_m: 0.02, rotation_error_rad: 0.1, velocity_mps: 0.4 };
        let (p_GP, v_WO) = (Point3::origin(), Vector3::zeros());
        let start = Waypoint { time_s: 0.0, X_WG, p_GP, v_WO, fraction: Some(1.0), tolerance };
        problem.waypoints[0].tolerance = tolerance;
        problem.waypoints.push(start);
        problem.keeps_start = StartState::Nothing;
        problem.stretch = [0.98, 1.02];
        problem.speed_fraction = [0.3; 2];
        (problem.comfortable_q, problem.first_will_do) = (None, true);
        problem.limits.iter_mut().for_each(|limits| limits.acceleration = f64::INFINITY);
        let found = problem.solve(&[problem.start.q; 8]).unwrap();
        assert!(found.excess < MET, "{found:?}");
        let end_s = found.spline.end_s();
        assert!((0.49..=0.51).contains(&end_s), "{end_s}");
        let [q, dq, _] = found.spline.evaluate(0.0);
        assert!((robot.gripper_pose(&q).translation.vector - X_WG.translation.vector).amax() <= 0.02 + 1e-6);
        assert!(robot.gripper_twist(&q, &dq).linear.amax() <= 0.4 + 1e-6);
        for i in 0..=200 {
            let [_, dq, _] = found.spline.evaluate(end_s * f64::from(i) / 200.0);
            assert!(problem.limits.iter().enumerate().all(|(j, limits)| dq[j].abs() <= limits.velocity * (1.0 + 1e-6)));
        }
    }

    #[test]
    fn what_is_out_of_reach_is_approached_within_the_limits() {
        let robot = iiwa();
        let mut problem = problem(&robot, &JointVector::repeat(0.2));
        problem.waypoints[0].X_WG.translation.vector.z += 3.0;
        let found = problem.solve(&[problem.start.q; 8]).unwrap();
        assert!(found.excess > 1.0);
        let start = robot.gripper_pose(&problem.start.q).translation.vector.z;
        assert!(robot.gripper_pose(&found.spline.evaluate(0.5)[0]).translation.vector.z > start + 0.02);
    }
}
