//! The swivel angles at which every joint of an S-R-S arm lies within a range: exact, as arcs.
//!
//! With the gripper's pose and the branch given, each joint is the angle of a direction, or the inverse cosine of a
//! number, whose components have the form h(ψ) = h₀ + h₁·cos ψ + h₂·sin ψ in the swivel angle ψ (Shimizu et al., 2008,
//! section IV). A bound on the joint is the sign of such a form, and each sign change is an inverse cosine away. So nothing
//! is lost between samples, and where no arc is left no swivel does.

use nalgebra::{Rotation3, Vector3};

use super::{ElbowCircle, EulerForms, SrsArm, basis};

/// h₀ + h₁·cos ψ + h₂·sin ψ.
pub(super) type Harmonic = Vector3<f64>;

/// Most separate arcs of one branch: each of six joints cuts at most one gap with two ends, and ±π cuts one more.
const MAX_ARCS: usize = 16;

/// A set of swivel angles within [−π, π]: disjoint arcs in rising order.
#[derive(Debug, Clone, Copy)]
pub struct Arcs {
    ends: [[f64; 2]; MAX_ARCS],
    count: usize,
}

impl Arcs {
    const NONE: Self = Self { ends: [[0.0; 2]; MAX_ARCS], count: 0 };

    fn full() -> Self {
        let mut arcs = Self::NONE;
        arcs.push([-std::f64::consts::PI, std::f64::consts::PI]);
        arcs
    }

    /// Lower and upper end of every arc.
    pub fn iter(&self) -> impl Iterator<Item = &[f64; 2]> {
        self.ends[..self.count].iter()
    }

    /// Whether no angle is left.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Whether `swivel` lies in one of them.
    pub fn contains(&self, swivel: f64) -> bool {
        self.iter().any(|[low, high]| (*low..=*high).contains(&swivel))
    }

    fn push(&mut self, arc: [f64; 2]) {
        if self.count < MAX_ARCS {
            self.ends[self.count] = arc;
            self.count += 1;
        }
    }

    /// Where h ≥ 0: h₀ + r·cos(ψ − φ) is there within ±acos(−h₀/r) of φ.
    fn where_positive(h: &Harmonic) -> Self {
        let r = (h.y * h.y + h.z * h.z).sqrt();
        if h.x >= r {
            return Self::full();
        }
        if h.x < -r {
            return Self::NONE;
        }
        let (middle, half) = (h.z.atan2(h.y), (-h.x / r).acos());
        Self::between(middle - half, middle + half)
    }

    /// From `low` to `high` ≤ `low` + 2π, wrapped at ±π.
    fn between(low: f64, high: f64) -> Self {
        use std::f64::consts::{PI, TAU};
        let mut arcs = Self::NONE;
        if low < -PI {
            arcs.push([-PI, high]);
            arcs.push([low + TAU, PI]);
        } else if high > PI {
            arcs.push([-PI, high - TAU]);
            arcs.push([low, PI]);
        } else {
            arcs.push([low, high]);
        }
        arcs
    }

    fn intersection(&self, other: &Self) -> Self {
        let mut both = Self::NONE;
        for one in self.iter() {
            for two in other.iter() {
                let (low, high) = (one[0].max(two[0]), one[1].min(two[1]));
                if low <= high {
                    both.push([low, high]);
                }
            }
        }
        both
    }

    fn complement(&self) -> Self {
        let mut rest = Self::NONE;
        let mut from = -std::f64::consts::PI;
        for [low, high] in self.iter() {
            if from < *low {
                rest.push([from, *low]);
            }
            from = *high;
        }
        if from < std::f64::consts::PI {
            rest.push([from, std::f64::consts::PI]);
        }
        rest
    }

    /// Where the direction (`x`, `y`) has an angle in [low, high], a part of [−π, π].
    fn where_angle(x: &Harmonic, y: &Harmonic, low: f64, high: f64) -> Self {
        // Left of the ray at `low`, and right of that at `high`.
        let left_of = |angle: f64| Self::where_positive(&(y * angle.cos() - x * angle.sin()));
        let right_of = |angle: f64| Self::where_positive(&(x * angle.sin() - y * angle.cos()));
        let width = high - low;
        if width >= std::f64::consts::TAU {
            Self::full()
        } else if width < std::f64::consts::PI {
            left_of(low).intersection(&right_of(high))
        } else {
            // The rest is less than half a turn: left of `high` and right of `low`.
            left_of(high).intersection(&right_of(low)).complement()
        }
    }

    /// Where acos h lies in [low, high], a part of [0, π].
    fn where_arc_cosine(h: &Harmonic, low: f64, high: f64) -> Self {
        let offset = |by: f64| Harmonic::new(by, 0.0, 0.0);
        let below = if low <= 0.0 { Self::full() } else { Self::where_positive(&(offset(low.cos()) - h)) };
        let above =
            if high >= std::f64::consts::PI { Self::full() } else { Self::where_positive(&(h - offset(high.cos()))) };
        below.intersection(&above)
    }
}

/// One of the eight solutions for a swivel angle: the signs of the elbow, of the second and of the sixth joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Branch {
    /// Whether the elbow bends backwards.
    pub elbow: bool,
    /// Whether the shoulder is turned over.
    pub shoulder: bool,
    /// Whether the wrist is turned over.
    pub wrist: bool,
}

impl Branch {
    /// All of them, in the order of [`SrsArm::solve`].
    pub const ALL: [Self; 8] = {
        let mut all = [Self { elbow: false, shoulder: false, wrist: false }; 8];
        let mut i = 0;
        while i < 8 {
            all[i] = Self { elbow: i & 4 != 0, shoulder: i & 2 != 0, wrist: i & 1 != 0 };
            i += 1;
        }
        all
    };
}

impl SrsArm {
    /// For each branch the swivel angles at which all joints are within `ranges` (lower and upper bound each, in radians).
    pub fn swivels(&self, circle: &ElbowCircle, ranges: &[[f64; 2]; 7]) -> [(Branch, Arcs); 8] {
        let mut found = Branch::ALL.map(|branch| (branch, Arcs::NONE));
        for (i, elbow_sign) in [1.0, -1.0].into_iter().enumerate() {
            let q4 = elbow_sign * circle.elbow_bend;
            if !(ranges[3][0]..=ranges[3][1]).contains(&q4) {
                continue;
            }
            let (shoulder, wrist) = self.forms(circle, elbow_sign);
            let shoulders = [1.0, -1.0].map(|sign| self.within(&shoulder, 0, sign, ranges));
            if shoulders.iter().all(Arcs::is_empty) {
                continue;
            }
            let wrists = [1.0, -1.0].map(|sign| self.within(&wrist, 4, sign, ranges));
            for (j, shoulder) in shoulders.iter().enumerate() {
                for (k, wrist) in wrists.iter().enumerate() {
                    found[4 * i + 2 * j + k].1 = shoulder.intersection(wrist);
                }
            }
        }
        found
    }

    /// By how much at most each joint turns, in radians, while the elbow moves by up to `by` radians from `swivel`.
    ///
    /// A form changes by r·by at most; so does the direction (x, y) whose angle a joint is.
    pub fn turned_by(&self, circle: &ElbowCircle, swivel: f64, branch: Branch, by: f64) -> [f64; 7] {
        let (shoulder, wrist) = self.forms(circle, if branch.elbow { -1.0 } else { 1.0 });
        let at = Harmonic::new(1.0, swivel.cos(), swivel.sin());
        let change = |h: &Harmonic| h.y.hypot(h.z) * by;
        let angle = |[x, y]: &[Harmonic; 2]| {
            let share = change(x).hypot(change(y)) / x.dot(&at).hypot(y.dot(&at));
            if share < 1.0 { share.asin() } else { std::f64::consts::TAU }
        };
        let arc_cosine = |h: &Harmonic| {
            let arc = |value: f64| value.clamp(-1.0, 1.0).acos();
            let (value, change) = (h.dot(&at), change(h));
            (arc(value - change) - arc(value)).max(arc(value) - arc(value + change))
        };
        let turned = |forms: &EulerForms| [angle(&forms.first), arc_cosine(&forms.along), angle(&forms.last)];
        let ([a, b, c], [e, f, g]) = (turned(&shoulder), turned(&wrist));
        [a, b, c, 0.0, e, f, g]
    }

    /// Where three joints that turn about u, b, u from `first` on keep their ranges; `sign` is that of the middle one.
    fn within(&self, forms: &EulerForms, first: usize, sign: f64, ranges: &[[f64; 2]; 7]) -> Arcs {
        let u = self.along.into_inner();
        let ordered = |joint: usize, sign: f64| {
            let [low, high] = ranges[joint];
            let (low, high) = if sign > 0.0 { (low, high) } else { (-high, -low) };
            (low.max(-std::f64::consts::PI), high.min(std::f64::consts::PI))
        };
        let (low, high) = ordered(first + 1, sign);
        if high < 0.0 || low > high {
            return Arcs::NONE;
        }
        let mut arcs = Arcs::where_arc_cosine(&forms.along, low.max(0.0), high);
        for (joint, [x, y]) in [(first, &forms.first), (first + 2, &forms.last)] {
            if arcs.is_empty() {
                break;
            }
            let (low, high) = ordered(joint, self.axes[joint].dot(&u).signum());
            if low > high {
                return Arcs::NONE;
            }
            arcs = arcs.intersection(&Arcs::where_angle(&(x * sign), &(y * sign), low, high));
        }
        arcs
    }

    /// The forms of shoulder and wrist.
    ///
    /// For R = Rᵤ(α)·R_b(β)·Rᵤ(γ) and c = b × u: R·u = u·cos β + (c·cos α + b·sin α)·sin β and
    /// Rᵀ·u = u·cos β + (−c·cos γ + b·sin γ)·sin β.
    fn forms(&self, circle: &ElbowCircle, elbow_sign: f64) -> (EulerForms, EulerForms) {
        let u = self.along.into_inner();
        let a4 = self.axes[3].into_inner();
        let bend = Rotation3::from_axis_angle(&self.axes[3], elbow_sign * circle.elbow_bend);
        let before = basis(u, a4).transpose();
        let R_target = (circle.R_WG * self.R_WG.inverse()).into_inner();
        // Columns of R_03 in the basis (u, a4, u × a4), as vectors of harmonics: column k is Σ over 1, cos ψ, sin ψ.
        let (sin, cos) = circle.shoulder_angle.sin_cos();
        let w = circle.to_wrist;
        let upper = [w * cos, circle.across[0] * sin, circle.across[1] * sin];
        let axis = [Vector3::zeros(), circle.across[0].cross(&w) * elbow_sign, circle.across[1].cross(&w) * elbow_sign];
        // upper × (aside × w) = aside·(upper·w) − w·(upper·aside).
        let third = [-w * sin * elbow_sign, circle.across[0] * cos * elbow_sign, circle.across[1] * cos * elbow_sign];
        // R_03·p for a direction p, and R_03ᵀ·p.
        let turned = |p: &Vector3<f64>| {
            let p = before * p;
            [0, 1, 2].map(|k| upper[k] * p.x + axis[k] * p.y + third[k] * p.z)
        };
        let turned_back = |p: &Vector3<f64>| {
            [0, 1, 2].map(|k| before.transpose() * Vector3::new(upper[k].dot(p), axis[k].dot(p), third[k].dot(p)))
        };
        let harmonic = |vectors: &[Vector3<f64>; 3], along: &Vector3<f64>| {
            Harmonic::new(vectors[0].dot(along), vectors[1].dot(along), vectors[2].dot(along))
        };
        let forms = |forward: &[Vector3<f64>; 3], backward: &[Vector3<f64>; 3], b: &Vector3<f64>| {
            let c = b.cross(&u);
            EulerForms {
                along: harmonic(forward, &u),
                first: [harmonic(forward, &c), harmonic(forward, b)],
                last: [-harmonic(backward, &c), harmonic(backward, b)],
            }
        };
        let shoulder = forms(&turned(&u), &turned_back(&u), &self.axes[1]);
        // R_47 = R(q₄)ᵀ·R_03ᵀ·R_target.
        let forward = turned_back(&(R_target * u)).map(|p| bend.inverse() * p);
        let backward = turned(&(bend * u)).map(|p| R_target.transpose() * p);
        let wrist = forms(&forward, &backward, &self.axes[5]);
        (shoulder, wrist)
    }
}
