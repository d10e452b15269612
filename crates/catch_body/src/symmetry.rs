//! Rotations under which an object looks the same. What looks the same cannot be observed, and must not be
//! compared.

use std::f64::consts::{PI, TAU};

use crate::{distance_field::DistanceField, pose::across};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Unit, UnitQuaternion, Vector3};

/// A finite group of rotations about the centre of mass, without the identity, in O.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotationGroup {
    rotations: [UnitQuaternion<f64>; MOST_ROTATIONS],
    count: usize,
}

/// The rotations of a cube, without the identity.
const MOST_ROTATIONS: usize = 23;
/// Rotations are different if one is at least this far from the other.
const DIFFERENT_RAD: f64 = 0.1;

impl Default for RotationGroup {
    fn default() -> Self {
        Self { rotations: [UnitQuaternion::identity(); MOST_ROTATIONS], count: 0 }
    }
}

impl RotationGroup {
    /// The group that `generators` make; rotations that are nearly the same are one, and what goes beyond
    /// those of a cube is left out.
    pub fn generated(generators: impl IntoIterator<Item = UnitQuaternion<f64>>) -> Self {
        let mut group = Self::default();
        generators.into_iter().for_each(|it| group.insert(it));
        let mut first = 0;
        while first < group.count {
            for second in 0..group.count {
                let [a, b] = [group.rotations[first], group.rotations[second]];
                group.insert(a * b);
                group.insert(b * a);
            }
            first += 1;
        }
        group
    }

    fn insert(&mut self, rotation: UnitQuaternion<f64>) {
        let is_known = self.rotations().iter().any(|it| it.angle_to(&rotation) < DIFFERENT_RAD);
        if !is_known && rotation.angle() > DIFFERENT_RAD && self.count < MOST_ROTATIONS {
            self.rotations[self.count] = rotation;
            self.count += 1;
        }
    }

    /// Rotations of the group but the identity.
    pub fn rotations(&self) -> &[UnitQuaternion<f64>] {
        &self.rotations[..self.count]
    }

    /// Number of rotations of the group, with the identity.
    pub fn order(&self) -> usize {
        self.count + 1
    }
}

/// Rotations about the centre of mass under which the object looks the same, and with that how much of its
/// rotation matters.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "an object has one, which a box would keep from being copied")]
pub enum Symmetry {
    /// No symmetry by a small angle: the whole orientation can be seen, except for a finite group of
    /// rotations.
    Finite {
        /// Rotations in O that leave it looking the same, such as the half turns of a box.
        group: RotationGroup,
        /// Inertia tensor about the centre of mass in O, divided by the mass, in m²: it rules the tumbling.
        inertia_per_kg: Matrix3<f64>,
    },
    /// Any turn about one axis: only where the axis points can be seen. It turns at a constant rate about a
    /// fixed direction whatever the spin (the free symmetric top).
    Axis {
        /// The axis in O.
        axis: Unit<Vector3<f64>>,
        /// True if the object also looks the same with the axis reversed.
        reversible: bool,
        /// Moment of inertia about the axis, divided by that across it. The axis turns about the angular
        /// momentum at ω_⊥ + this·ω_∥.
        axial_inertia: f64,
    },
    /// Any turn at all.
    Sphere,
}

impl Default for Symmetry {
    fn default() -> Self {
        Self::Finite { group: RotationGroup::default(), inertia_per_kg: Matrix3::identity() }
    }
}

/// Orders of the axes of prisms, the highest first.
const ORDERS: [f64; 6] = [8.0, 6.0, 5.0, 4.0, 3.0, 2.0];
/// Principal moments that differ by less than this fraction are nearly equal.
const NEARLY_EQUAL: f64 = 0.15;
/// Axes that are tried between two.
const STEPS: u32 = 36;
/// Directions that are tried where every axis could be one: 7° apart.
const DIRECTIONS: u32 = 400;
/// Axes of one order that are looked at: a cube has four of the third.
const MOST_AXES: usize = 7;
/// Axes nearer than this, in radians, are one: those of a cube are 0.6 apart or more.
const APART: f64 = 0.3;
/// Resolution to which an axis is found, in radians.
const FINEST_STEP: f64 = 2e-3;
/// Angles that a turn is tried by: none divides a full turn, so prisms are not taken for cylinders.
const TRIAL_ANGLES: [f64; 5] = [0.4, 0.9, 1.7, 2.3, 3.0];

impl Symmetry {
    /// Tries rotations about the principal axes of an object given by its points and distance field in O and
    /// its second moment ∫ x·xᵀ dV / V: it looks the same if the rotated points lie within `tolerance_m`
    /// (root mean square) of the surface, for single rotations within `confused_m`, for turns by any angle
    /// within half of that: what is not told apart in flight.
    pub fn find(
        points: &[Point3<f64>],
        distance: &DistanceField,
        second_moment: &Matrix3<f64>,
        tolerance_m: f64,
        confused_m: f64,
    ) -> Self {
        let mean_square = |turn: UnitQuaternion<f64>| {
            let squares: f64 = points.iter().map(|point| distance.at(&(turn * point)).0.powi(2)).sum();
            squares / points.len() as f64
        };
        let round_m = tolerance_m.max(confused_m / 2.0);
        let looks_the_same = |turn: UnitQuaternion<f64>| mean_square(turn) <= round_m * round_m;
        let eigen = SymmetricEigen::new(*second_moment);
        let principal = [0, 1, 2].map(|i| Unit::new_normalize(eigen.eigenvectors.column(i).into_owned()));
        let around = principal.map(|axis| {
            TRIAL_ANGLES.iter().all(|&angle| looks_the_same(UnitQuaternion::from_axis_angle(&axis, angle)))
        });
        match around {
            [true, true, true] => Self::Sphere,
            [false, false, false] => {
                let rotations =
                    |axis: &Unit<Vector3<f64>>| ORDERS.map(|order| UnitQuaternion::from_axis_angle(axis, TAU / order));
                let axes = Self::distinct(principal, &eigen.eigenvalues.into(), &mean_square);
                let is_confused = |turn: &UnitQuaternion<f64>| mean_square(*turn) <= confused_m * confused_m;
                // Of each axis the highest order.
                let highest = axes.iter().filter_map(|axis| rotations(axis).into_iter().find(is_confused));
                let group = RotationGroup::generated(highest);
                // Inertia from the second moment: J = tr(S)·1 − S.
                let inertia_per_kg = Matrix3::identity() * second_moment.trace() - second_moment;
                Self::Finite { group, inertia_per_kg }
            }
            _ => {
                let which = around.iter().position(|&same| same).unwrap_or(0);
                let across = principal[(which + 1) % 3];
                let reversed = UnitQuaternion::from_axis_angle(&across, PI);
                // J_∥ = tr(S) − s and J_⊥ = (tr(S) + s)/2, s being the second moment along the axis.
                let [trace, along] = [second_moment.trace(), eigen.eigenvalues[which]];
                let axial_inertia = 2.0 * (trace - along) / (trace + along);
                Self::Axis { axis: principal[which], reversible: looks_the_same(reversed), axial_inertia }
            }
        }
    }

    /// Axes of rotations that may leave an object as it looks, where its principal axes are arbitrary: where
    /// two principal moments are nearly equal, as those of a prism, one of both is the axis about which half
    /// a turn changes least; where all three are, as those of a cube or a tetrahedron, axes are looked for
    /// all around.
    fn distinct(
        principal: [Unit<Vector3<f64>>; 3],
        moments: &[f64; 3],
        mean_square: &impl Fn(UnitQuaternion<f64>) -> f64,
    ) -> Vec<Unit<Vector3<f64>>> {
        let is_near = |(i, j): &(usize, usize)| (moments[*i] / moments[*j] - 1.0).abs() < NEARLY_EQUAL;
        let mut near = [(0, 1), (1, 2), (2, 0)].into_iter().filter(is_near);
        let Some((i, j)) = near.next() else { return principal.into() };
        if near.count() == 2 {
            return Self::all_around(mean_square);
        }
        let axis = |step: u32| {
            let (sin, cos) = libm::sincos(PI * f64::from(step) / f64::from(STEPS));
            Unit::new_normalize(principal[i].into_inner() * cos + principal[j].into_inner() * sin)
        };
        let changed = |step: u32| mean_square(UnitQuaternion::from_axis_angle(&axis(step), PI));
        let changes: Vec<f64> = (0..STEPS).map(changed).collect();
        let least =
            (0..STEPS).min_by(|a, b| changes[*a as usize].total_cmp(&changes[*b as usize])).map_or(principal[i], axis);
        let third = principal[3 - i - j];
        vec![least, Unit::new_normalize(third.cross(&least)), third]
    }

    /// The axes about which a third of a turn, and a half, changes least: the groups of tetrahedron, cube and
    /// octahedron are made by those.
    fn all_around(mean_square: &impl Fn(UnitQuaternion<f64>) -> f64) -> Vec<Unit<Vector3<f64>>> {
        // Evenly spread over half a sphere (Fibonacci's lattice).
        let golden = PI * (3.0 - 5.0_f64.sqrt());
        let direction = |i: u32| {
            let z = 1.0 - (f64::from(i) + 0.5) / f64::from(DIRECTIONS);
            let (sin, cos) = libm::sincos(golden * f64::from(i));
            Vector3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + Vector3::z() * z
        };
        let mut axes: Vec<Unit<Vector3<f64>>> = Vec::new();
        for order in [3.0, 2.0] {
            let changed = |axis: &Vector3<f64>| {
                mean_square(UnitQuaternion::from_axis_angle(&Unit::new_normalize(*axis), TAU / order))
            };
            let mut tried: Vec<(f64, Vector3<f64>)> =
                (0..DIRECTIONS).map(direction).map(|axis| (changed(&axis), axis)).collect();
            tried.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut chosen: Vec<Vector3<f64>> = Vec::new();
            for (least, axis) in tried {
                if chosen.len() < MOST_AXES && chosen.iter().all(|it| it.dot(&axis).abs() < libm::cos(APART)) {
                    chosen.push(Self::nearest_minimum(axis, least, &changed));
                }
            }
            axes.extend(chosen.into_iter().map(Unit::new_normalize));
        }
        axes
    }

    /// Compass search from an axis for one that changes less (Hooke and Jeeves, 1961).
    fn nearest_minimum(
        mut axis: Vector3<f64>,
        mut least: f64,
        changed: &impl Fn(&Vector3<f64>) -> f64,
    ) -> Vector3<f64> {
        let mut step = APART / 4.0;
        while step > FINEST_STEP {
            let one = across(&axis);
            let aside = [one, axis.cross(&one)].into_iter().flat_map(|it| [it, -it]);
            let tried = aside.map(|it| (axis + it * step).normalize()).map(|it| (changed(&it), it));
            match tried.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|it| it.0 < least) {
                Some(better) => (least, axis) = better,
                None => step /= 2.0,
            }
        }
        axis
    }

    /// The symmetry that the object would have if its two ends looked alike.
    #[must_use]
    pub fn with_ends_alike(self) -> Self {
        match self {
            Self::Axis { axis, axial_inertia, .. } => Self::Axis { axis, reversible: true, axial_inertia },
            other => other,
        }
    }

    /// Projects a small turn, given in O, on what can be seen of it.
    pub fn observable(&self) -> Matrix3<f64> {
        match self {
            Self::Finite { .. } => Matrix3::identity(),
            Self::Axis { axis, .. } => Matrix3::identity() - axis.into_inner() * axis.transpose(),
            Self::Sphere => Matrix3::zeros(),
        }
    }

    /// The orientation nearest to `R_WA` in which the object looks as it does at `R_WB`.
    ///
    /// What cannot be seen of an orientation drifts from image to image; whoever follows it must hold on to
    /// one of all that look alike.
    pub fn nearest_alike(&self, R_WA: &UnitQuaternion<f64>, R_WB: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(self.turn_between(R_WA, R_WB)) * R_WA
    }

    /// The turn in W, as a rotation vector, that takes the looks of an object at `R_WA` to those at `R_WB`,
    /// and is smallest.
    pub fn turn_between(&self, R_WA: &UnitQuaternion<f64>, R_WB: &UnitQuaternion<f64>) -> Vector3<f64> {
        match self {
            Self::Finite { group, .. } => {
                let alike = |rotation: &UnitQuaternion<f64>| (R_WA * rotation).rotation_to(R_WB);
                // The angle is the smaller the larger |w| is.
                let smaller = |least: UnitQuaternion<f64>, other: UnitQuaternion<f64>| {
                    if other.w.abs() > least.w.abs() { other } else { least }
                };
                group.rotations().iter().map(alike).fold(R_WA.rotation_to(R_WB), smaller).scaled_axis()
            }
            Self::Axis { axis, reversible, .. } => {
                let (from, mut to) = (R_WA * axis.into_inner(), R_WB * axis.into_inner());
                if *reversible && from.dot(&to) < 0.0 {
                    to = -to;
                }
                let cross = from.cross(&to);
                let sine = cross.norm();
                let angle = libm::atan2(sine, from.dot(&to));
                if sine > 1e-12 {
                    cross * (angle / sine)
                } else if angle > 1.0 {
                    // Exactly opposite: any perpendicular direction will do.
                    across(&from) * angle
                } else {
                    Vector3::zeros()
                }
            }
            Self::Sphere => Vector3::zeros(),
        }
    }
}
