//! The swivel angles at which every joint of an S-R-S arm lies within a range: exact, as arcs.
//!
//! With the gripper's pose and the branch given, each joint is the angle of a direction, or the inverse
//! cosine of a number, whose components have the form h(ψ) = h₀ + h₁·cos ψ + h₂·sin ψ in the swivel angle ψ
//! (Shimizu et al., 2008, section IV). A bound on the joint is the sign of such a form, and each sign change
//! is an inverse cosine away. So nothing is lost between samples, and where no arc is left no swivel does.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::{ElbowCircle, EulerForms, Ranges, SrsArm, basis};

/// h₀ + h₁·cos ψ + h₂·sin ψ.
pub(super) type Harmonic = Vector3<f64>;

/// A set of swivel angles within [−π, π]: at most `MOST` disjoint arcs in rising order.
#[derive(Debug, Clone, Copy)]
struct Arcs<const MOST: usize> {
    ends: [[f64; 2]; MOST],
    count: usize,
}

/// Angles at which a form is positive: an arc, which ±π may cut in two.
type Arc = Arcs<2>;
/// Angles at which two forms are positive, or at which not both are.
type TwoArcs = Arcs<4>;
/// Angles at which three joints keep their ranges: each of six forms cuts at most one gap, and ±π one more.
type Joints = Arcs<10>;

impl<const MOST: usize> Arcs<MOST> {
    const NONE: Self = Self { ends: [[0.0; 2]; MOST], count: 0 };

    fn full() -> Self {
        let mut arcs = Self::NONE;
        arcs.push([-std::f64::consts::PI, std::f64::consts::PI]);
        arcs
    }

    /// Lower and upper end of every arc.
    fn iter(&self) -> impl Iterator<Item = &[f64; 2]> {
        self.ends[..self.count].iter()
    }

    /// Returns whether no angle is left.
    fn is_empty(&self) -> bool {
        self.count == 0
    }

    fn push(&mut self, arc: [f64; 2]) {
        if self.count < MOST {
            self.ends[self.count] = arc;
            self.count += 1;
        }
    }

    /// The arcs of what both have in common.
    fn shared_with<const OTHERS: usize>(&self, other: &Arcs<OTHERS>) -> impl Iterator<Item = [f64; 2]> {
        let pairs = self.iter().flat_map(|one| other.iter().map(move |two| [one[0].max(two[0]), one[1].min(two[1])]));
        pairs.filter(|[low, high]| low <= high)
    }

    fn intersection<const OTHERS: usize, const BOTH: usize>(&self, other: &Arcs<OTHERS>) -> Arcs<BOTH> {
        let mut both = Arcs::NONE;
        self.shared_with(other).for_each(|arc| both.push(arc));
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
    /// Angles at which h ≥ 0: h₀ + r·cos(ψ − φ) is nonnegative within ±acos(−h₀/r) of φ.
    fn where_positive(h: &Harmonic) -> Self {
        let r = (h.y * h.y + h.z * h.z).sqrt();
        if h.x >= r {
            return Self::full();
        }
        if h.x < -r {
            return Self::NONE;
        }
        let (middle, half) = (libm::atan2(h.z, h.y), libm::acos(-h.x / r));
        Self::between(middle - half, middle + half)
    }

    /// Arc from `low` to `high` ≤ `low` + 2π, wrapped at ±π.
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
    /// Angles at which both forms are positive.
    fn where_both_positive(one: &Harmonic, two: &Harmonic) -> Self {
        // Forms are intersected only if both may be positive: the costly test is skipped otherwise.
        let may_be_positive = |h: &Harmonic| h.x >= 0.0 || h.x * h.x <= h.y * h.y + h.z * h.z;
        if may_be_positive(one) && may_be_positive(two) {
            Arc::where_positive(one).intersection(&Arc::where_positive(two))
        } else {
            Self::NONE
        }
    }
}

/// A range of angles, a part of [−π, π], with the sines and cosines of its ends.
struct AngleRange {
    width: f64,
    low: (f64, f64),
    high: (f64, f64),
}

impl AngleRange {
    fn new(low: f64, high: f64) -> Self {
        Self { width: high - low, low: libm::sincos(low), high: libm::sincos(high) }
    }

    /// Angles at which the direction (`x`, `y`) has an angle in the range.
    fn contains(&self, x: &Harmonic, y: &Harmonic) -> TwoArcs {
        let left_of = |(sin, cos): (f64, f64)| y * cos - x * sin;
        let right_of = |(sin, cos): (f64, f64)| x * sin - y * cos;
        if self.width < 0.0 {
            TwoArcs::NONE
        } else if self.width >= std::f64::consts::TAU {
            TwoArcs::full()
        } else if self.width < std::f64::consts::PI {
            TwoArcs::where_both_positive(&left_of(self.low), &right_of(self.high))
        } else {
            // The rest is less than half a turn: left of the upper end and right of the lower.
            TwoArcs::where_both_positive(&left_of(self.high), &right_of(self.low)).complement()
        }
    }
}

/// The ranges of three joints that turn about u, b and u.
struct Bounds {
    outer: [AngleRange; 2],
    /// Lower and upper end, and their cosines.
    middle: [f64; 2],
    cosines: [f64; 2],
}

impl Bounds {
    /// Angles at which all three joints keep their ranges; `sign` is that of the middle one.
    fn kept_by(&self, forms: &EulerForms, sign: f64) -> Joints {
        let ([low, high], [cos_low, cos_high]) = (self.middle, self.cosines);
        let (low, high, cos_low, cos_high) =
            if sign > 0.0 { (low, high, cos_low, cos_high) } else { (-high, -low, cos_high, cos_low) };
        if high < 0.0 || low > high {
            return Joints::NONE;
        }
        // The middle one is the inverse cosine of a form.
        let offset = |by: f64| Harmonic::new(by, 0.0, 0.0);
        let always = offset(1.0);
        let below = if low <= 0.0 { always } else { offset(cos_low) - forms.along };
        let above = if high >= std::f64::consts::PI { always } else { forms.along - offset(cos_high) };
        let mut arcs: Joints = Joints::full().intersection(&TwoArcs::where_both_positive(&below, &above));
        for (range, [x, y]) in self.outer.iter().zip([&forms.first, &forms.last]) {
            if arcs.is_empty() {
                break;
            }
            arcs = arcs.intersection(&range.contains(&(x * sign), &(y * sign)));
        }
        arcs
    }
}

/// Branch of the eight solutions for a swivel angle: the signs of the elbow, of the second and of the sixth
/// joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Branch {
    /// True if the elbow bends backwards.
    pub elbow: bool,
    /// True if the shoulder is flipped.
    pub shoulder: bool,
    /// True if the wrist is flipped.
    pub wrist: bool,
}

impl Branch {
    /// All branches.
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
    /// The arcs of swivel angles, each with its branch, on which all joints are within `ranges` (lower and
    /// upper bound each, in radians).
    pub fn swivels(&self, circle: &ElbowCircle, ranges: &Ranges) -> Vec<(Branch, [f64; 2])> {
        let mut found = Vec::new();
        let mut bounds = None;
        for elbow in [false, true] {
            let elbow_sign = if elbow { -1.0 } else { 1.0 };
            let q4 = elbow_sign * circle.elbow_bend;
            if !(ranges[3][0]..=ranges[3][1]).contains(&q4) {
                continue;
            }
            let [at_shoulder, at_wrist] = bounds.get_or_insert_with(|| [0, 4].map(|first| self.bounds(first, ranges)));
            let upper_arm = self.upper_arm_forms(circle, elbow_sign);
            let forms = self.shoulder_forms(&upper_arm);
            let shoulders = [1.0, -1.0].map(|sign| at_shoulder.kept_by(&forms, sign));
            if shoulders.iter().all(Joints::is_empty) {
                continue;
            }
            let forms = self.wrist_forms(&upper_arm, circle, elbow_sign);
            let wrists = [1.0, -1.0].map(|sign| at_wrist.kept_by(&forms, sign));
            for (shoulder, at_shoulder) in [false, true].into_iter().zip(&shoulders) {
                for (wrist, at_wrist) in [false, true].into_iter().zip(&wrists) {
                    let branch = Branch { elbow, shoulder, wrist };
                    found.extend(at_shoulder.shared_with(at_wrist).map(|arc| (branch, arc)));
                }
            }
        }
        found
    }

    /// The bounds of the joints `first` to `first` + 2.
    fn bounds(&self, first: usize, ranges: &Ranges) -> Bounds {
        let u = self.along.into_inner();
        let outer = |joint: usize| {
            let [low, high] = ranges[joint];
            let (low, high) = if self.axes[joint].dot(&u) > 0.0 { (low, high) } else { (-high, -low) };
            AngleRange::new(low.max(-std::f64::consts::PI), high.min(std::f64::consts::PI))
        };
        let [low, high] = ranges[first + 1];
        Bounds {
            outer: [outer(first), outer(first + 2)],
            middle: [low, high],
            cosines: [libm::cos(low), libm::cos(high)],
        }
    }

    /// Upper bound of each joint's rotation in radians while the elbow moves by up to `by` radians from
    /// `swivel`.
    ///
    /// A form changes by r·by at most; so does the direction (x, y) whose angle a joint is.
    pub fn turned_by(&self, circle: &ElbowCircle, swivel: f64, branch: Branch, by: f64) -> [f64; 7] {
        let elbow_sign = if branch.elbow { -1.0 } else { 1.0 };
        let upper_arm = self.upper_arm_forms(circle, elbow_sign);
        let (shoulder, wrist) = (self.shoulder_forms(&upper_arm), self.wrist_forms(&upper_arm, circle, elbow_sign));
        let at = Harmonic::new(1.0, libm::cos(swivel), libm::sin(swivel));
        let change = |h: &Harmonic| libm::hypot(h.y, h.z) * by;
        let angle = |[x, y]: &[Harmonic; 2]| {
            let fraction = libm::hypot(change(x), change(y)) / libm::hypot(x.dot(&at), y.dot(&at));
            if fraction < 1.0 { libm::asin(fraction) } else { std::f64::consts::TAU }
        };
        let arc_cosine = |h: &Harmonic| {
            let arc = |value: f64| libm::acos(value.clamp(-1.0, 1.0));
            let (value, change) = (h.dot(&at), change(h));
            (arc(value - change) - arc(value)).max(arc(value) - arc(value + change))
        };
        let turned = |forms: &EulerForms| [angle(&forms.first), arc_cosine(&forms.along), angle(&forms.last)];
        let ([a, b, c], [e, f, g]) = (turned(&shoulder), turned(&wrist));
        [a, b, c, 0.0, e, f, g]
    }

    /// Columns of R_03 in the basis (u, a₄, u × a₄), as vectors of harmonics: column k is Σ over 1, cos ψ,
    /// sin ψ.
    fn upper_arm_forms(&self, circle: &ElbowCircle, elbow_sign: f64) -> UpperArm {
        let (sin, cos) = libm::sincos(circle.shoulder_angle);
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

    /// Coefficients of R = Rᵤ(α)·R_b(β)·Rᵤ(γ), b being the axis of joint `middle`, and c = b × u: R·u = u·cos
    /// β + (c·cos α + b·sin α)·sin β and Rᵀ·u = u·cos β + (−c·cos γ + b·sin γ)·sin β; `forward` is R·u and
    /// `backward` Rᵀ·u.
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

/// The orientation of the upper arm, R_03, as forms of the swivel angle.
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
