//! Small, dense, strictly convex quadratic programs by the dual active-set method.
//!
//! ```text
//!     min  ½ xᵀH x + gᵀx      subject to   lᵢ ≤ aᵢᵀx ≤ uᵢ
//!      x
//! ```
//! Goldfarb & Idnani, A numerically stable dual method for solving strictly convex quadratic programs,
//! Mathematical Programming 27 (1983). It starts at the unconstrained minimum and adds violated constraints
//! one by one, so that it is quickest where few constraints bind, and it proves infeasibility. No allocation:
//! at most [`MAX_VARIABLES`] variables. Rows whose entries beyond a short range vanish, as those of splines
//! do, cost only that range.

use nalgebra::{SMatrix, SVector};

/// Reason for which a quadratic program has no solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProgramFailure {
    /// No point keeps all bounds.
    Infeasible,
    /// The solver was not done after as many steps as it may take.
    IterationLimit,
    /// Rounding errors left no way on.
    Numerical,
}

/// The most variables a program may have. Unused ones must have a unit diagonal in H and appear in no
/// constraint.
pub const MAX_VARIABLES: usize = 10;

/// One number per variable.
pub type Variables = SVector<f64, MAX_VARIABLES>;
/// A square matrix over the variables.
pub type Square = SMatrix<f64, MAX_VARIABLES, MAX_VARIABLES>;

/// The normal a of a constraint.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    a: Variables,
    /// Beyond this range a vanishes.
    first: usize,
    last: usize,
    /// 1/|a|.
    scale: f64,
}

impl Row {
    /// A row with these entries.
    #[inline]
    pub fn new(a: Variables) -> Self {
        let first = a.iter().position(|it| *it != 0.0).unwrap_or(0);
        let last = a.iter().rposition(|it| *it != 0.0).map_or(0, |it| it + 1);
        Self { a, first, last, scale: 1.0 / a.norm() }
    }

    /// Returns whether the row is zero.
    #[inline]
    pub fn is_zero(&self) -> bool {
        self.last == 0
    }

    fn dot(&self, x: &Variables) -> f64 {
        (self.first..self.last).map(|i| self.a[i] * x[i]).sum()
    }
}

/// Lowest and highest value of aᵀx; an equality where they are the same.
pub type Bounds = [f64; 2];

/// The quadratic cost, factorized once for any number of programs.
#[derive(Debug, Clone)]
pub struct Hessian {
    /// L⁻ᵀ with H = L·Lᵀ.
    factor: Square,
}

impl Hessian {
    /// Factorizes H, `None` if it is not positive definite.
    pub fn new(H: &Square) -> Option<Self> {
        let inverse = H.cholesky()?.l_dirty().solve_lower_triangular(&Square::identity())?;
        Some(Self { factor: inverse.transpose() })
    }

    /// The minimum. Rows that are equalities come first: `equalities` of them.
    ///
    /// # Errors
    /// If no x keeps all bounds, or none was found that does.
    pub fn minimize(
        &self,
        gradient: &Variables,
        rows: &[Row],
        bounds: &[Bounds],
        equalities: usize,
    ) -> Result<Variables, ProgramFailure> {
        let mut active = ActiveSet {
            rows,
            equalities,
            J: self.factor,
            R: Square::zeros(),
            multipliers: Variables::zeros(),
            size: self.factor.norm_squared(),
            indices: [0; MAX_VARIABLES],
            signs: [0.0; MAX_VARIABLES],
            count: 0,
        };
        let mut x = -(self.factor * (self.factor.transpose() * gradient));
        // Each constraint that enters and leaves again costs a pass; a cycle means numerical trouble.
        for _ in 0..20 * (rows.len() + 1) {
            let Some((index, sign)) = active.most_violated(&x, bounds) else {
                return if keeps(&x, rows, bounds) { Ok(x) } else { Err(ProgramFailure::Numerical) };
            };
            let bound = if sign > 0.0 { bounds[index][0] } else { -bounds[index][1] };
            active.enter(&mut x, index, sign, bound)?;
        }
        Err(ProgramFailure::IterationLimit)
    }
}

/// Violations below this, relative to the size of the bound, count as rounding.
const TOLERANCE: f64 = 1e-12;

/// A solution may break a bound by this at most, relative to the size of the bound.
const RESIDUAL: f64 = 1e-6;

/// Returns whether a solution keeps all bounds, the active ones too, from which rounding may have led it
/// away.
fn keeps(x: &Variables, rows: &[Row], bounds: &[Bounds]) -> bool {
    rows.iter().zip(bounds).all(|(row, [low, high])| {
        let value = row.dot(x);
        let within = |bound: f64| RESIDUAL * (1.0 + if bound.is_finite() { bound.abs() } else { 0.0 });
        value >= low - within(*low) && value <= high + within(*high)
    }) && x.iter().all(|value| value.is_finite())
}

/// Normals whose rest beside the active ones is less than this fraction of them depend on these.
const DEPENDENT: f64 = 1e-7;

/// The constraints that hold with equality, and what they leave free.
struct ActiveSet<'a> {
    /// Rows of all constraints, the equalities first.
    rows: &'a [Row],
    equalities: usize,
    /// Orthogonal transform of L⁻ᵀ: its first `count` columns span the active normals in the metric of H.
    J: Square,
    /// Upper triangular, `count` × `count`.
    R: Square,
    multipliers: Variables,
    /// |J|², which the transforms leave as it is.
    size: f64,
    indices: [usize; MAX_VARIABLES],
    /// Signs of the normals, so that all constraints are lower bounds.
    signs: [f64; MAX_VARIABLES],
    count: usize,
}

/// Step direction along which a constraint becomes active.
struct Direction {
    /// Normal of the constraint in the columns of J.
    d: Variables,
    /// Direction in x that keeps the active constraints, and aᵀz.
    z: Variables,
    curvature: f64,
    /// Change of the active constraints' multipliers along the direction.
    r: Variables,
}

impl ActiveSet<'_> {
    fn contains(&self, index: usize) -> bool {
        self.indices[..self.count].contains(&index)
    }

    /// The next constraint to enter: equalities first, then the most violated by distance; with the sign that
    /// makes it a lower bound.
    fn most_violated(&self, x: &Variables, bounds: &[Bounds]) -> Option<(usize, f64)> {
        let mut worst = None;
        let mut most = 0.0;
        for (index, (row, [low, high])) in self.rows.iter().zip(bounds).enumerate() {
            let value = row.dot(x);
            if index < self.equalities {
                if self.contains(index) {
                    continue;
                }
                return Some((index, if value > *low { -1.0 } else { 1.0 }));
            }
            let (below, above) = (low - value, value - high);
            let (violation, bound, sign) = if below > above { (below, low, 1.0) } else { (above, high, -1.0) };
            if violation > TOLERANCE * (1.0 + bound.abs()) && violation * row.scale > most && !self.contains(index) {
                most = violation * row.scale;
                worst = Some((index, sign));
            }
        }
        worst
    }

    /// Moves `x` until sign·aᵀx ≥ `bound` holds, dropping what stands in the way.
    fn enter(&mut self, x: &mut Variables, index: usize, sign: f64, bound: f64) -> Result<(), ProgramFailure> {
        let row = &self.rows[index];
        let mut multiplier = 0.0;
        loop {
            let Direction { d, z, curvature, r } = self.direction(row, sign);
            let (partial, blocking) = self.longest_step(&r);
            // The step that fulfils the constraint.
            let slack = sign * row.dot(x) - bound;
            let full =
                if curvature * row.scale * row.scale > 1e-13 * self.size { -slack / curvature } else { f64::INFINITY };

            let step = partial.min(full);
            if !step.is_finite() {
                // No direction is left: redundant if it already holds, else infeasible.
                return match index < self.equalities && slack.abs() < 1e-9 {
                    true => Ok(()),
                    false if self.spans(row, sign, &r) => Err(ProgramFailure::Infeasible),
                    false => Err(ProgramFailure::Numerical),
                };
            }
            multiplier += step;
            for slot in 0..self.count {
                self.multipliers[slot] -= step * r[slot];
            }
            if full.is_finite() {
                x.axpy(step, &z, 1.0);
            }
            if full <= partial {
                return self.add(index, sign, &d, multiplier);
            }
            let Some(slot) = blocking else { return Err(ProgramFailure::Numerical) };
            self.drop(slot);
        }
    }

    fn direction(&self, row: &Row, sign: f64) -> Direction {
        let mut d = Variables::zeros();
        for column in 0..MAX_VARIABLES {
            let column_J = self.J.column(column);
            d[column] = sign * (row.first..row.last).map(|i| row.a[i] * column_J[i]).sum::<f64>();
        }
        let mut z = Variables::zeros();
        let mut curvature = 0.0;
        for column in self.count..MAX_VARIABLES {
            z.axpy(d[column], &self.J.column(column), 1.0);
            curvature += d[column] * d[column];
        }
        let mut r = Variables::zeros();
        for row in (0..self.count).rev() {
            let sum: f64 = (row + 1..self.count).map(|column| self.R[(row, column)] * r[column]).sum();
            r[row] = (d[row] - sum) / self.R[(row, row)];
        }
        Direction { d, z, curvature, r }
    }

    /// The longest step before an inequality's multiplier turns negative, and which does.
    fn longest_step(&self, r: &Variables) -> (f64, Option<usize>) {
        let mut longest = (f64::INFINITY, None);
        for slot in 0..self.count {
            if self.indices[slot] >= self.equalities && r[slot] > 0.0 {
                let step = self.multipliers[slot] / r[slot];
                if step < longest.0 {
                    longest = (step, Some(slot));
                }
            }
        }
        longest
    }

    /// Returns whether the normal of a constraint is the combination `r` of the active ones, but for
    /// rounding. Where no multiplier can fall then, the constraints contradict each other (Farkas' lemma).
    fn spans(&self, row: &Row, sign: f64, r: &Variables) -> bool {
        let mut rest = row.a * sign;
        for slot in 0..self.count {
            rest.axpy(-r[slot] * self.signs[slot], &self.rows[self.indices[slot]].a, 1.0);
        }
        rest.norm() * row.scale < DEPENDENT
    }

    /// Appends a constraint: rotates J's free columns so that only the first of them meets its normal.
    fn add(&mut self, index: usize, sign: f64, d: &Variables, multiplier: f64) -> Result<(), ProgramFailure> {
        if self.count == MAX_VARIABLES {
            return Err(ProgramFailure::Numerical);
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
        self.signs[self.count] = sign;
        self.multipliers[self.count] = multiplier;
        self.count += 1;
        Ok(())
    }

    /// Removes a constraint and makes R triangular again.
    fn drop(&mut self, slot: usize) {
        for column in slot..self.count - 1 {
            let next = self.R.column(column + 1).into_owned();
            self.R.set_column(column, &next);
            self.indices[column] = self.indices[column + 1];
            self.signs[column] = self.signs[column + 1];
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
    let length = (a * a + b * b).sqrt();
    if length == 0.0 { (1.0, 0.0, 0.0) } else { (a / length, b / length, length) }
}

fn rotate_columns(matrix: &mut Square, left: usize, right: usize, c: f64, s: f64) {
    for row in 0..MAX_VARIABLES {
        let (a, b) = (matrix[(row, left)], matrix[(row, right)]);
        matrix[(row, left)] = c * a + s * b;
        matrix[(row, right)] = c * b - s * a;
    }
}
