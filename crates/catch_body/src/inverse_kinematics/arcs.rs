//! The swivel angles at which every joint of an S-R-S arm lies within a range: exact, as arcs.
//!
//! With the gripper's pose and the branch given, each joint is the angle of a direction, or the inverse cosine of a
//! number, whose components have the form h(ψ) = h₀ + h₁·cos ψ + h₂·sin ψ in the swivel angle ψ (Shimizu et al., 2008,
//! section IV). A bound on the joint is the sign of such a form, and each sign change is an inverse cosine away. So nothing
//! is lost between samples, and where no arc is left no swivel does.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::{ElbowCircle, EulerForms, SrsArm, basis};

/// h₀ + h₁·cos ψ + h₂·sin ψ.
pub(super) type Harmonic = Vector3<f64>;

/// A set of swivel angles within [−π, π]: at most `MOST` disjoint arcs in rising order.
#[derive(Debug, Clone, Copy)]
pub struct Arcs<const MOST: usize = 16> {
    ends: [[f64; 2]; MOST],
    count: usize,
}

/// Where a form is positive: an arc, which ±π may cut in two.
type Arc = Arcs<2>;
/// Where two are, or where not both are.
type TwoArcs = Arcs<4>;
/// Where three joints keep their ranges: each of six forms cuts at most one gap, and ±π one more.
type Joints = Arcs<10>;

impl<const MOST: usize> Arcs<MOST> {
    const NONE: Self = Self { ends: [[0.0; 2]; MOST], count: 0 };

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
        if self.count < MOST {
            self.ends[self.count] = arc;
            self.count += 1;
        }
    }

    fn intersection<const OTHERS: usize, const BOTH: usize>(&self, other: &Arcs<OTHERS>) -> Arcs<BOTH> {
        let mut both = Arcs::NONE;
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
}

impl Arc {
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
}

impl TwoArcs {
    /// Where both forms are positive.
    fn where_both_positive(one: &Harmonic, two: &Harmonic) -> Self {
        // Where one is positive nowhere the costly question need not be asked of the other.
        let may_be_positive = |h: &Harmonic| h.x >= 0.0 || h.x * h.x <= h.y * h.y + h.z * h.z;
        if may_be_positive(one) && may_be_positive(two) {
            Arc::where_positive(one).intersection(&Arc::where_positive(two))
        } else {
            Self::NONE
        }
    }

    /// Where the direction (`x`, `y`) has an angle in [low, high], a part of [−π, π].
    fn where_angle(x: &Harmonic, y: &Harmonic, low: f64, high: f64) -> Self {
        // Left of the ray at `low`, and right of that at `high`.
        let left_of = |angle: f64| y * angle.cos() - x * angle.sin();
        let right_of = |angle: f64| x * angle.sin() - y * angle.cos();
        let width = high - low;
        if width >= std::f64::consts::TAU {
            Self::full()
        } else if width < std::f64::consts::PI {
            Self::where_both_positive(&left_of(low), &right_of(high))
        } else {
            // The rest is less than half a turn: left of `high` and right of `low`.
            Self::where_both_positive(&left_of(high), &right_of(low)).complement()
        }
    }

    /// Where acos h lies in [low, high], a part of [0, π].
    fn where_arc_cosine(h: &Harmonic, low: f64, high: f64) -> Self {
        let offset = |by: f64| Harmonic::new(by, 0.0, 0.0);
        let always = offset(1.0);
        let below = if low <= 0.0 { always } else { offset(low.cos()) - h };
        let above = if high >= std::f64::consts::PI { always } else { h - offset(high.cos()) };
        Self::where_both_positive(&below, &above)
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
            let upper_arm = self.upper_arm_forms(circle, elbow_sign);
            let shoulder = self.shoulder_forms(&upper_arm);
            let shoulders = [1.0, -1.0].map(|sign| self.within(&shoulder, 0, sign, ranges));
            if shoulders.iter().all(Joints::is_empty) {
                continue;
            }
            let wrist = self.wrist_forms(&upper_arm, circle, elbow_sign);
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
        let elbow_sign = if branch.elbow { -1.0 } else { 1.0 };
        let upper_arm = self.upper_arm_forms(circle, elbow_sign);
        let (shoulder, wrist) = (self.shoulder_forms(&upper_arm), self.wrist_forms(&upper_arm, circle, elbow_sign));
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
    fn within(&self, forms: &EulerForms, first: usize, sign: f64, ranges: &[[f64; 2]; 7]) -> Joints {
        let u = self.along.into_inner();
        let ordered = |joint: usize, sign: f64| {
            let [low, high] = ranges[joint];
            let (low, high) = if sign > 0.0 { (low, high) } else { (-high, -low) };
            (low.max(-std::f64::consts::PI), high.min(std::f64::consts::PI))
        };
        let (low, high) = ordered(first + 1, sign);
        if high < 0.0 || low > high {
            return Joints::NONE;
        }
        let mut arcs = Joints::full().intersection(&TwoArcs::where_arc_cosine(&forms.along, low.max(0.0), high));
        for (joint, [x, y]) in [(first, &forms.first), (first + 2, &forms.last)] {
            if arcs.is_empty() {
                break;
            }
            let (low, high) = ordered(joint, self.axes[joint].dot(&u).signum());
            if low > high {
                return Joints::NONE;
            }
            arcs = arcs.intersection(&TwoArcs::where_angle(&(x * sign), &(y * sign), low, high));
        }
        arcs
    }

    /// Columns of R_03 in the basis (u, a₄, u × a₄), as vectors of harmonics: column k is Σ over 1, cos ψ, sin ψ.
    fn upper_arm_forms(&self, circle: &ElbowCircle, elbow_sign: f64) -> UpperArm {
        let (sin, cos) = circle.shoulder_angle.sin_cos();
        let w = circle.to_wrist;
        UpperArm {
            before: basis(self.along.into_inner(), self.axes[3].into_inner()),
            upper: [w * cos, circle.across[0] * sin, circle.across[1] * sin],
            axis: [Vector3::zeros(), circle.across[0].cross(&w) * elbow_sign, circle.across[1].cross(&w) * elbow_sign],
            // upper × (aside × w) = aside·(upper·w) − w·(upper·aside).
            third: [-w * sin * elbow_sign, circle.across[0] * cos * elbow_sign, circle.across[1] * cos * elbow_sign],
        }
    }

    fn shoulder_forms(&self, upper_arm: &UpperArm) -> EulerForms {
        let u = self.along.into_inner();
        self.euler_forms(&upper_arm.turned(&u), &upper_arm.turned_back(&u), 1)
    }

    /// R_47 = R(q₄)ᵀ·R_03ᵀ·R_target.
    fn wrist_forms(&self, upper_arm: &UpperArm, circle: &ElbowCircle, elbow_sign: f64) -> EulerForms {
        let u = self.along.into_inner();
        let bend = Rotation3::from_axis_angle(&self.axes[3], elbow_sign * circle.elbow_bend);
        let R_target = (circle.R_WG * self.R_WG.inverse()).into_inner();
        let forward = upper_arm.turned_back(&(R_target * u)).map(|p| bend.inverse() * p);
        let backward = upper_arm.turned(&(bend * u)).map(|p| R_target.transpose() * p);
        self.euler_forms(&forward, &backward, 5)
    }

    /// For R = Rᵤ(α)·R_b(β)·Rᵤ(γ), b being the axis of joint `middle`, and c = b × u: R·u = u·cos β + (c·cos α + b·sin α)·sin β
    /// and Rᵀ·u = u·cos β + (−c·cos γ + b·sin γ)·sin β; `forward` is R·u and `backward` Rᵀ·u.
    fn euler_forms(&self, forward: &[Vector3<f64>; 3], backward: &[Vector3<f64>; 3], middle: usize) -> EulerForms {
        let harmonic = |vectors: &[Vector3<f64>; 3], along: &Vector3<f64>| {
            Harmonic::new(vectors[0].dot(along), vectors[1].dot(along), vectors[2].dot(along))
        };
        let (u, b) = (self.along.into_inner(), self.axes[middle].into_inner());
        let c = b.cross(&u);
        EulerForms {
            along: harmonic(forward, &u),
            first: [harmonic(forward, &c), harmonic(forward, &b)],
            last: [-harmonic(backward, &c), harmonic(backward, &b)],
        }
    }
}

/// The attitude of the upper arm, R_03, as forms of the swivel angle.
struct UpperArm {
    before: Matrix3<f64>,
    upper: [Vector3<f64>; 3],
    axis: [Vector3<f64>; 3],
    third: [Vector3<f64>; 3],
}

impl UpperArm {
    /// R_03·p for a direction p.
    fn turned(&self, p: &Vector3<f64>) -> [Vector3<f64>; 3] {
        let p = self.before.tr_mul(p);
        [0, 1, 2].map(|k| self.upper[k] * p.x + self.axis[k] * p.y + self.third[k] * p.z)
    }

    /// R_03ᵀ·p.
    fn turned_back(&self, p: &Vector3<f64>) -> [Vector3<f64>; 3] {
        [0, 1, 2].map(|k| self.before * Vector3::new(self.upper[k].dot(p), self.axis[k].dot(p), self.third[k].dot(p)))
    }
}
