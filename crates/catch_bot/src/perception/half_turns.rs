//! Distinction between orientations that are half a turn apart.
//!
//! Half a turn about a principal axis leaves an object's extents as they are, and the features that
//! distinguish both orientations may be smaller than a pixel where the object is first seen. All images
//! together decide: each adds how much better one of the orientations explains it.

use std::f64::consts::PI;

use catch_body::{Pose, pose::across};
use nalgebra::{SymmetricEigen, UnitQuaternion, Vector3};

use super::{Symmetry, registration::Fit};

/// Largest evidence of one image, so that no single one decides: −2 × the logarithm of a likelihood ratio.
const MOST_OF_IMAGE: f64 = 4.0;
/// Evidence beyond which the other orientation is believed: it is e⁴ times as likely. Two images give no
/// more.
const DECISIVE: f64 = 8.0;
/// Evidence for the present orientation from which on the other one is no longer asked for.
const SETTLED: f64 = 20.0;
/// An image that gives less evidence does not tell both orientations apart, nor will the next few.
const TELLING: f64 = 2.0;
/// Most images that are passed over between two comparisons.
const LONGEST_PAUSE: usize = 7;
/// Steps from the other orientation before it is compared: it is near by then, and one that is not counts as
/// worse.
pub(super) const COMPARED_AFTER: usize = 8;
/// Orientations of the same looks are closer than this.
const ALIKE_RAD: f64 = 0.3;

/// One of the half turns.
#[derive(Debug, Clone, Copy)]
struct HalfTurn {
    /// Rotation of the object, in O.
    rotation: UnitQuaternion<f64>,
    /// Evidence for the rotation.
    evidence: f64,
    /// Images that are passed over between two comparisons, and how many of them are left.
    pause: usize,
    left: usize,
}

/// The half turns that change an object's looks, and what the images so far say for them.
#[derive(Debug, Clone)]
pub(super) struct HalfTurns {
    symmetry: Symmetry,
    turns: Vec<HalfTurn>,
    /// Number of the rotation that is tested next.
    next: usize,
}

impl HalfTurns {
    pub fn new(symmetry: &Symmetry) -> Self {
        let axes: Vec<Vector3<f64>> = match symmetry {
            Symmetry::Sphere => Vec::new(),
            Symmetry::Axis { axis, .. } => vec![across(axis)],
            Symmetry::Finite { inertia_per_kg, .. } => SymmetricEigen::new(*inertia_per_kg)
                .eigenvectors
                .column_iter()
                .map(nalgebra::Matrix::into_owned)
                .collect(),
        };
        let rotations = axes.iter().map(|axis| UnitQuaternion::from_scaled_axis(axis * PI));
        let changes =
            |it: &UnitQuaternion<f64>| symmetry.turn_between(&UnitQuaternion::identity(), it).norm() > ALIKE_RAD;
        let turns =
            rotations.filter(changes).map(|rotation| HalfTurn { rotation, evidence: 0.0, pause: 0, left: 0 }).collect();
        Self { symmetry: *symmetry, turns, next: 0 }
    }

    /// Forgets all images.
    pub fn reset(&mut self) {
        self.turns.iter_mut().for_each(|it| (it.evidence, it.pause, it.left) = (0.0, 0, 0));
        self.next = 0;
    }

    /// Compares `fit` with what `register` makes of the same images from one of the half turns. Returns the
    /// latter once the images speak for it.
    pub fn compare(&mut self, fit: &Fit, register: impl FnOnce(&Pose) -> Fit) -> Option<Fit> {
        let open = (0..self.turns.len()).map(|i| (self.next + i) % self.turns.len());
        let asked = open.into_iter().find(|i| self.turns[*i].evidence > -SETTLED && self.turns[*i].left == 0);
        self.turns.iter_mut().for_each(|it| it.left = it.left.saturating_sub(1));
        let asked = asked?;
        self.next = asked + 1;
        let turn = &mut self.turns[asked];
        let turned = Pose::from_parts(fit.X_WO.translation, fit.X_WO.rotation * turn.rotation);
        // One that leads back to the same looks says nothing for it.
        let differs = |it: &Fit| self.symmetry.turn_between(&fit.X_WO.rotation, &it.X_WO.rotation).norm() > ALIKE_RAD;
        let other = Some(register(&turned)).filter(differs);
        let better = other.map_or(-MOST_OF_IMAGE, |other| fit.robust_cost - other.robust_cost);
        turn.evidence += better.clamp(-MOST_OF_IMAGE, MOST_OF_IMAGE);
        turn.pause = if better.abs() < TELLING { (2 * turn.pause + 1).min(LONGEST_PAUSE) } else { 0 };
        turn.left = turn.pause;
        let is_other = turn.evidence > DECISIVE;
        if is_other {
            self.reset();
        }
        other.filter(|_| is_other)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Matrix6, Vector3};

    use super::*;
    use crate::perception::RotationGroup;

    /// A fit, turned about x, that explains its images by so much better than one of cost 0.
    fn fit(about_x_rad: f64, better: f64) -> Fit {
        Fit {
            X_WO: Pose::rotation(Vector3::x() * about_x_rad),
            information: Matrix6::zeros(),
            points: 0,
            residual_m: 0.0,
            silhouette_residual_m: None,
            points_mismatch: None,
            silhouette_mismatch: None,
            robust_cost: -better,
            noise_m: 0.0,
            iterations: 0,
        }
    }

    #[test]
    fn what_looks_the_same_is_not_asked_for() {
        let axis = |reversible| Symmetry::Axis { axis: Vector3::z_axis(), reversible, axial_inertia: 1.0 };
        let inertia_per_kg = Matrix3::from_diagonal(&Vector3::new(1.0, 2.0, 3.0));
        let finite = |group| Symmetry::Finite { group, inertia_per_kg };
        let box_like = [Vector3::x(), Vector3::y()].map(|it| UnitQuaternion::from_scaled_axis(it * PI));
        let count = |symmetry: Symmetry| HalfTurns::new(&symmetry).turns.len();
        assert_eq!([count(Symmetry::Sphere), count(axis(true)), count(axis(false))], [0, 0, 1]);
        assert_eq!(count(finite(RotationGroup::default())), 3);
        assert_eq!(count(finite(RotationGroup::generated(box_like))), 0);
        assert_eq!(count(finite(RotationGroup::generated([box_like[0]]))), 2);
    }

    #[test]
    fn several_images_decide_and_settle() {
        let new = || HalfTurns::new(&Symmetry::Axis { axis: Vector3::z_axis(), reversible: false, axial_inertia: 1.0 });
        // A single one has no say, however clear it is, nor have many that contradict each other.
        let mut turns = new();
        for better in [1e6, 3.0, -1e6, 1e6, -5.0, -1e6] {
            assert!(turns.compare(&fit(0.0, 0.0), |_| fit(PI, better)).is_none());
        }
        let mut turns = new();
        let decided = (1..10).find(|_| turns.compare(&fit(0.0, 0.0), |_| fit(PI, 3.5)).is_some());
        assert_eq!(decided, Some(3));
        // An image that says little lets more and more others pass.
        let (mut turns, mut asked) = (new(), Vec::new());
        for image in 0..32 {
            turns.compare(&fit(0.0, 0.0), |_| {
                asked.push(image);
                fit(PI, 0.1)
            });
        }
        assert_eq!(asked, [0, 2, 6, 14, 22, 30]);
        // Where the other one is worse, or leads back, it is soon left alone.
        for leads_to in [fit(PI, -1e6), fit(0.1, 1e6)] {
            let (mut turns, mut asked) = (new(), 0);
            for _ in 0..100 {
                let found = turns.compare(&fit(0.0, 0.0), |_| {
                    asked += 1;
                    leads_to
                });
                assert!(found.is_none());
            }
            assert_eq!(asked, 5);
        }
    }
}
