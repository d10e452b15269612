//! Turns under which an object looks the same. What looks the same cannot be observed, and must not be compared.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Unit, UnitQuaternion, Vector3};

use super::distance_field::DistanceField;

/// Turns about the centre of mass under which the object looks the same, and with that how much of its turning matters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Symmetry {
    /// None by a small angle: the whole orientation can be seen, except perhaps for half a turn.
    None {
        /// The axis in O about which half a turn leaves it looking the same, if there is one; of several one.
        half_turn: Option<Unit<Vector3<f64>>>,
        /// Inertia tensor about the centre of mass in O, divided by the mass, in m²: it rules the tumbling.
        inertia_per_kg: Matrix3<f64>,
    },
    /// Any turn about one axis: only where the axis points can be seen. It turns at a constant rate about a fixed direction
    /// whatever the spin (the free symmetric top), so no inertia is needed.
    Axis {
        /// The axis in O.
        axis: Unit<Vector3<f64>>,
        /// Whether the object also looks the same with the axis reversed.
        reversible: bool,
    },
    /// Any turn at all.
    Sphere,
}

impl Default for Symmetry {
    fn default() -> Self {
        Self::None { half_turn: None, inertia_per_kg: Matrix3::identity() }
    }
}

/// Angles that a turn is tried by: none divides a full turn, so prisms are not taken for cylinders.
const TRIAL_ANGLES: [f64; 5] = [0.4, 0.9, 1.7, 2.3, 3.0];

impl Symmetry {
    /// Tries turns about the principal axes of an object given by its points and distance field in O and its second moment
    /// ∫ x·xᵀ dV / V: it looks the same if the turned points lie within `tolerance_m` (root mean square) of the surface.
    pub(super) fn find(
        points: &[Point3<f64>],
        distance: &DistanceField,
        second_moment: &Matrix3<f64>,
        tolerance_m: f64,
    ) -> Self {
        let looks_the_same = |turn: UnitQuaternion<f64>| {
            let squares: f64 = points.iter().map(|point| distance.at(&(turn * point)).0.powi(2)).sum();
            squares <= tolerance_m * tolerance_m * points.len() as f64
        };
        let eigen = SymmetricEigen::new(*second_moment);
        let principal = [0, 1, 2].map(|i| Unit::new_normalize(eigen.eigenvectors.column(i).into_owned()));
        let around = principal.map(|axis| {
            TRIAL_ANGLES.iter().all(|&angle| looks_the_same(UnitQuaternion::from_axis_angle(&axis, angle)))
        });
        match around {
            [true, true, true] => Self::Sphere,
            [false, false, false] => {
                let mut half_turns = principal
                    .into_iter()
                    .filter(|axis| looks_the_same(UnitQuaternion::from_axis_angle(axis, std::f64::consts::PI)));
                // Inertia from the second moment: J = tr(S)·1 − S.
                let inertia_per_kg = Matrix3::identity() * second_moment.trace() - second_moment;
                Self::None { half_turn: half_turns.next(), inertia_per_kg }
            }
            _ => {
                let which = around.iter().position(|&same| same).unwrap_or(0);
                let across = principal[(which + 1) % 3];
                let reversed = UnitQuaternion::from_axis_angle(&across, std::f64::consts::PI);
                Self::Axis { axis: principal[which], reversible: looks_the_same(reversed) }
            }
        }
    }

    /// Projects a small turn, given in O, on what can be seen of it.
    pub fn observable(&self) -> Matrix3<f64> {
        match self {
            Self::None { .. } => Matrix3::identity(),
            Self::Axis { axis, .. } => Matrix3::identity() - axis.into_inner() * axis.transpose(),
            Self::Sphere => Matrix3::zeros(),
        }
    }

    /// The orientation nearest to `R_WA` in which the object looks as it does at `R_WB`.
    ///
    /// What cannot be seen of an orientation drifts from image to image; whoever follows it must hold on to one of all that look
    /// alike.
    pub fn nearest_alike(&self, R_WA: &UnitQuaternion<f64>, R_WB: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(self.turn_between(R_WA, R_WB)) * R_WA
    }

    /// The turn in W, as a rotation vector, that takes the looks of an object at `R_WA` to those at `R_WB`, and is smallest.
    pub fn turn_between(&self, R_WA: &UnitQuaternion<f64>, R_WB: &UnitQuaternion<f64>) -> Vector3<f64> {
        match self {
            Self::None { half_turn, .. } => {
                let turn = R_WA.rotation_to(R_WB);
                let other = half_turn.map(|axis| {
                    (R_WA * UnitQuaternion::from_axis_angle(&axis, std::f64::consts::PI)).rotation_to(R_WB)
                });
                other.filter(|other| other.angle() < turn.angle()).unwrap_or(turn).scaled_axis()
            }
            Self::Axis { axis, reversible } => {
                let (from, mut to) = (R_WA * axis.into_inner(), R_WB * axis.into_inner());
                if *reversible && from.dot(&to) < 0.0 {
                    to = -to;
                }
                let cross = from.cross(&to);
                let sine = cross.norm();
                let angle = sine.atan2(from.dot(&to));
                if sine > 1e-12 {
                    cross * (angle / sine)
                } else if angle > 1.0 {
                    // Exactly opposite: any perpendicular direction will do.
                    let across = if from.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
                    from.cross(&across).normalize() * angle
                } else {
                    Vector3::zeros()
                }
            }
            Self::Sphere => Vector3::zeros(),
        }
    }
}
