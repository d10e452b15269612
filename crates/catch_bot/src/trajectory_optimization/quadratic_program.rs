//! Small, dense, strictly convex quadratic programs by the dual active-set method.
//!
//! ```text
//!     min  ½ xᵀH x + gᵀx      subject to   aᵢᵀx = bᵢ  (i < equalities),   aᵢᵀx ≥ bᵢ  (the others)
//!      x
//! ```
//! Goldfarb & Idnani, A numerically stable dual method for solving strictly convex quadratic programs, Mathematical
//! Programming 27 (1983). It starts at the unconstrained minimum and adds violated constraints one by one, so that it is
//! quickest where few constraints bind, and it proves infeasibility. No allocation: at most [`MAX_VARIABLES`] variables.

use nalgebra::{SMatrix, SVector};

/// The most variables a program may have. Unused ones must have a unit diagonal in H and appear in no constraint.
pub const MAX_VARIABLES: usize = 10;

/// One number per variable.
pub type Variables = SVector<f64, MAX_VARIABLES>;
/// A square matrix over the variables.
pub type Square = SMatrix<f64, MAX_VARIABLES, MAX_VARIABLES>;

/// aᵀx ≥ b, or = b.
#[derive(Debug, Clone, Copy)]
pub struct Constraint {
    /// Normal.
    pub a: Variables,
    /// Bound.
    pub b: f64,
}

/// The quadratic cost, factorized once for any number of programs.
#[derive(Debug, Clone)]
pub struct Hessian {
    /// L⁻ᵀ with H = L·Lᵀ.
    factor: Square,
}

impl Hessian {
    /// Factorizes H, `None` if it is not positive definite.
    pub fn new(H: &Square) -> Option<Self> {
        let L = H.cholesky()?.l();
        let factor = L.transpose().try_inverse()?;
        Some(Self { factor })
    }

    /// The minimum, `None` if no x fulfils all constraints. The first `equalities` constraints hold with equality.
    pub fn minimize(&self, gradient: &Variables, constraints: &[Constraint], equalities: usize) -> Option<Variables> {
        let mut active =
            ActiveSet { J: self.factor, R: Square::zeros(), multipliers: Variables::zeros(), ..ActiveSet::default() };
        let mut x = -(self.factor * (self.factor.transpose() * gradient));
        // Each constraint that enters and leaves again costs a pass; a cycle means numerical trouble.
        for _ in 0..20 * (constraints.len() + 1) {
            let Some((index, sign)) = most_violated(&x, constraints, equalities, &active) else {
                return x.iter().all(|value| value.is_finite()).then_some(x);
            };
            if !active.enter(&mut x, constraints, index, sign, equalities) {
                return None;
            }
        }
        None
    }
}

/// Violations below this, relative to the size of the constraint, count as rounding.
const TOLERANCE: f64 = 1e-12;

/// The next constraint to enter: equalities first, then the most violated; with the sign that makes it a lower bound.
fn most_violated(
    x: &Variables,
    constraints: &[Constraint],
    equalities: usize,
    active: &ActiveSet,
) -> Option<(usize, f64)> {
    let mut worst = None;
    let mut most = 0.0;
    for (index, constraint) in constraints.iter().enumerate() {
        if active.contains(index) {
            continue;
        }
        let slack = constraint.a.dot(x) - constraint.b;
        if index < equalities {
            return Some((index, if slack > 0.0 { -1.0 } else { 1.0 }));
        }
        if slack < most - TOLERANCE * (1.0 + constraint.b.abs()) {
            most = slack;
            worst = Some((index, 1.0));
        }
    }
    worst
}

#[derive(Default)]
struct ActiveSet {
    /// Orthogonal transform of L⁻ᵀ: its first `count` columns span the active normals in the metric of H.
    J: Square,
    /// Upper triangular, `count` × `count`.
    R: Square,
    multipliers: Variables,
    indices: [usize; MAX_VARIABLES],
    count: usize,
}

impl ActiveSet {
    fn contains(&self, index: usize) -> bool {
        self.indices[..self.count].contains(&index)
    }

    /// Moves `x` until constraint `index` holds, dropping what stands in the way. False: the constraints contradict.
    fn enter(
        &mut self,
        x: &mut Variables,
        constraints: &[Constraint],
        index: usize,
        sign: f64,
        equalities: usize,
    ) -> bool {
        let normal = constraints[index].a * sign;
        let bound = constraints[index].b * sign;
        let mut multiplier = 0.0;
        loop {
            let d = self.J.transpose() * normal;
            // z: direction in x that keeps the active constraints; r: how their multipliers change along it.
            let mut z = Variables::zeros();
            for column in self.count..MAX_VARIABLES {
                z += self.J.column(column) * d[column];
            }
            let mut r = Variables::zeros();
            for row in (0..self.count).rev() {
                let sum: f64 = (row + 1..self.count).map(|column| self.R[(row, column)] * r[column]).sum();
                r[row] = (d[row] - sum) / self.R[(row, row)];
            }

            // The longest step before an inequality's multiplier turns negative.
            let mut partial = f64::INFINITY;
            let mut blocking = None;
            for slot in 0..self.count {
                if self.indices[slot] >= equalities && r[slot] > 0.0 {
                    let step = self.multipliers[slot] / r[slot];
                    if step < partial {
                        partial = step;
                        blocking = Some(slot);
                    }
                }
            }
            // The step that fulfils the constraint.
            let curvature = z.dot(&normal);
            let slack = normal.dot(x) - bound;
            let full = if curvature > 1e-13 * normal.norm_squared() * self.J.norm_squared() {
                -slack / curvature
            } else {
                f64::INFINITY
            };

            let step = partial.min(full);
            if !step.is_finite() {
                // No direction is left: redundant if it already holds, else infeasible.
                return index < equalities && slack.abs() < 1e-9;
            }
            multiplier += step;
            for slot in 0..self.count {
                self.multipliers[slot] -= step * r[slot];
            }
            if full.is_finite() {
                *x += z * step;
            }
            if full <= partial {
                return self.add(index, &d, multiplier);
            }
            let Some(slot) = blocking else { return false };
            self.drop(slot);
        }
    }

    /// Appends a constraint: rotates J's free columns so that only the first of them meets its normal.
    fn add(&mut self, index: usize, d: &Variables, multiplier: f64) -> bool {
        if self.count == MAX_VARIABLES {
            return false;
        }
        let mut d = *d;
        for column in (self.count + 1..MAX_VARIABLES).rev() {
            let (c, s, length) = givens(d[column - 1], d[column]);
            if length == 0.0 {
                continue;
            }
            (d[column - 1], d[column]) = (length, 0.0);
            rotate_columns(&mut self.J, column - 1, column, c, s);
        }
        self.R.fixed_view_mut::<MAX_VARIABLES, 1>(0, self.count).copy_from(&d);
        self.indices[self.count] = index;
        self.multipliers[self.count] = multiplier;
        self.count += 1;
        true
    }

    /// Removes a constraint and makes R triangular again.
    fn drop(&mut self, slot: usize) {
        for column in slot..self.count - 1 {
            let next = self.R.column(column + 1).into_owned();
            self.R.set_column(column, &next);
            self.indices[column] = self.indices[column + 1];
            self.multipliers[column] = self.multipliers[column + 1];
        }
        self.count -= 1;
        for column in slot..self.count {
            let (c, s, _) = givens(self.R[(column, column)], self.R[(column + 1, column)]);
            for right in column..self.count {
                let (above, below) = (self.R[(column, right)], self.R[(column + 1, right)]);
                self.R[(column, right)] = c * above + s * below;
                self.R[(column + 1, right)] = c * below - s * above;
            }
            rotate_columns(&mut self.J, column, column + 1, c, s);
        }
    }
}

/// Cosine, sine and length of the rotation that takes (a, b) to (length, 0).
fn givens(a: f64, b: f64) -> (f64, f64, f64) {
    let length = a.hypot(b);
    if length == 0.0 { (1.0, 0.0, 0.0) } else { (a / length, b / length, length) }
}

fn rotate_columns(matrix: &mut Square, left: usize, right: usize, c: f64, s: f64) {
    for row in 0..MAX_VARIABLES {
        let (a, b) = (matrix[(row, left)], matrix[(row, right)]);
        matrix[(row, left)] = c * a + s * b;
        matrix[(row, right)] = c * b - s * a;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn variables() -> impl Strategy<Value = Variables> {
        prop::collection::vec(-1.0f64..1.0, MAX_VARIABLES).prop_map(|values| Variables::from_column_slice(&values))
    }

    proptest! {
        /// Karush–Kuhn–Tucker conditions, checked without the solver: no feasible point of a cloud around the solution is
        /// better, and the solution is feasible.
        #[test]
        fn solution_is_feasible_and_no_feasible_point_is_better(
            root in prop::collection::vec(-1.0f64..1.0, MAX_VARIABLES * MAX_VARIABLES),
            gradient in variables(),
            inside in variables(),
            normals in prop::collection::vec((variables(), 0.0f64..0.5), 1..25),
            equalities in 0usize..3,
            others in prop::collection::vec(variables(), 50),
        ) {
            let root = Square::from_column_slice(&root);
            let H = root * root.transpose() + Square::identity() * 0.1;
            // `inside` fulfils every constraint, so the program is feasible.
            let constraints: Vec<_> = normals.iter().enumerate().map(|(index, (a, slack))| {
                let slack = if index < equalities { 0.0 } else { *slack };
                Constraint { a: *a, b: a.dot(&inside) - slack }
            }).collect();
            let equalities = equalities.min(constraints.len());
            let x = Hessian::new(&H).unwrap().minimize(&gradient, &constraints, equalities).unwrap();
            let cost = |x: &Variables| 0.5 * x.dot(&(H * x)) + gradient.dot(x);
            for (index, constraint) in constraints.iter().enumerate() {
                let slack = constraint.a.dot(&x) - constraint.b;
                prop_assert!(slack > -1e-9 && (index >= equalities || slack < 1e-9), "constraint {index}: {slack}");
            }
            // The segment from the solution to any feasible point must rise.
            let fulfils = |y: &Variables| constraints.iter().enumerate().all(|(index, constraint)| {
                let slack = constraint.a.dot(y) - constraint.b;
                slack >= 0.0 && (index >= equalities || slack.abs() < 1e-9)
            });
            let slope = H * x + gradient;
            for y in others.iter().map(|other| inside + other * 0.1).chain([inside]).filter(fulfils) {
                prop_assert!(slope.dot(&(y - x)) > -1e-7, "descends toward a feasible point");
                prop_assert!(cost(&y) >= cost(&x) - 1e-9);
            }
        }
    }

    #[test]
    fn contradictions_are_reported() {
        let a = Variables::ith(0, 1.0);
        let constraints = [Constraint { a, b: 1.0 }, Constraint { a: -a, b: 0.0 }];
        assert!(Hessian::new(&Square::identity()).unwrap().minimize(&Variables::zeros(), &constraints, 0).is_none());
    }
}
