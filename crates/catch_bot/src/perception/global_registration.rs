//! Registration without a prior: from all around.

use catch_body::Pose;
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};

use super::{
    PerceptionStatus, Symmetry,
    point_cloud::SceneCloud,
    registration::{Fit, Registration},
    silhouette::SILHOUETTE_ABOVE_M,
};

/// Points that the orientations are compared on: enough to tell them apart.
const TRIAL_POINTS: usize = 100;
/// Steps from each orientation before they are compared.
const TRIAL_ITERATIONS: usize = 7;
/// Orientations that are then compared on all points.
const FINALISTS: usize = 3;
/// Steps of each before that: the right one is settled by then, or as good as.
const FINAL_ITERATIONS: usize = 5;
/// Orientations closer than this are one.
const SAME_ORIENTATION_RAD: f64 = 0.3;

/// Depths that err by more than this fraction of the object's inner radius do not tell orientations apart.
const BLURRED_FRACTION: f64 = 0.5;

impl Registration<'_> {
    /// Registers from `R_WO` after each of the 24 rotations of the cube, of which one is within 63° of any
    /// orientation, but once from those that look alike, and keeps the best.
    ///
    /// Orientations are compared on points alone, which is a third of the work, unless these err too much to
    /// tell them apart: then by the silhouette too. What cannot be observed of the orientation is taken from
    /// `R_WO`.
    pub fn register_globally(
        &self,
        scene: &mut SceneCloud,
        thinned: &mut SceneCloud,
        R_WO: &UnitQuaternion<f64>,
    ) -> Result<Fit, PerceptionStatus> {
        thinned.thin_from(scene, TRIAL_POINTS);
        let has_silhouette = !scene.silhouette.is_empty();
        let is_blurred = |error_m: f64| has_silhouette && error_m > BLURRED_FRACTION * self.reference.inner_radius_m;

        let told_m = scene.mean_noise_m();
        let mut finalists = self.try_all(thinned, R_WO, is_blurred(told_m));
        let mut with_silhouette = has_silhouette && told_m > SILHOUETTE_ABOVE_M;
        let mut best = self.best_of(&finalists, scene, with_silhouette);
        // Points that nobody told to be noisy turn out to be: again with the silhouette.
        if let Some(fit) = best.filter(|fit| !with_silhouette && has_silhouette && fit.residual_m > SILHOUETTE_ABOVE_M)
        {
            if is_blurred(fit.residual_m) {
                finalists = self.try_all(thinned, R_WO, true);
            }
            with_silhouette = true;
            best = self.best_of(&finalists, scene, with_silhouette);
        }
        self.register(scene, &best.ok_or(PerceptionStatus::NotConverged)?.X_WO, with_silhouette)
    }

    /// Candidate poses of the scene: the results of registrations that start in each of the 24 rotations of
    /// the cube, with the middle of the scene in the middle of the reference or at each of `anchors` of its
    /// surface.
    pub fn hypotheses<'a>(
        &'a self,
        scene: &'a mut SceneCloud,
        anchors: &'a [Point3<f64>],
    ) -> impl Iterator<Item = Fit> + 'a {
        let middle_W = scene.centroid().coords;
        let starts = (0..24).map(rotation_of_cube).flat_map(move |R_WO| {
            let at = move |p_O: Vector3<f64>| Pose::from_parts((middle_W - R_WO * p_O).into(), R_WO);
            std::iter::once(at(Vector3::zeros())).chain(anchors.iter().map(move |it| at(it.coords)))
        });
        starts.filter_map(|X_WO| self.register(scene, &X_WO, false).ok())
    }

    /// The orientations that a part of the scene speaks for most.
    fn try_all(
        &self,
        thinned: &mut SceneCloud,
        R_WO: &UnitQuaternion<f64>,
        with_silhouette: bool,
    ) -> [Option<Fit>; FINALISTS] {
        let p_WO = Translation3::from(thinned.centroid().coords);
        let symmetry = &self.reference.symmetry;
        let starts: [_; 24] = std::array::from_fn(|i| R_WO * rotation_of_cube(i));
        let alike = |A, B| symmetry.turn_between(A, B).norm() < SAME_ORIENTATION_RAD;
        let mut finalists = [None; FINALISTS];
        for (_, start) in starts.iter().enumerate().filter(|(i, it)| !starts[..*i].iter().any(|A| alike(A, it))) {
            let fit = self.iterate(thinned, &Pose::from_parts(p_WO, *start), TRIAL_ITERATIONS, with_silhouette).0;
            keep(&mut finalists, fit, symmetry);
        }
        finalists
    }

    /// The finalist that the whole scene speaks for most, after a few more steps.
    fn best_of(
        &self,
        finalists: &[Option<Fit>; FINALISTS],
        scene: &mut SceneCloud,
        with_silhouette: bool,
    ) -> Option<Fit> {
        let results = finalists.iter().flatten();
        let results = results.map(|fit| self.iterate(scene, &fit.X_WO, FINAL_ITERATIONS, with_silhouette).0);
        results.min_by(|a, b| a.robust_cost.total_cmp(&b.robust_cost))
    }
}

/// Keeps the best fits in order, each orientation once.
fn keep(finalists: &mut [Option<Fit>; FINALISTS], fit: Fit, symmetry: &Symmetry) {
    if !fit.robust_cost.is_finite() {
        return;
    }
    let alike = |it: &Fit| symmetry.turn_between(&it.X_WO.rotation, &fit.X_WO.rotation).norm() < SAME_ORIENTATION_RAD;
    if finalists.iter().flatten().any(|it| alike(it) && it.robust_cost <= fit.robust_cost) {
        return;
    }
    let others = finalists.map(|it| it.filter(|it| !alike(it)));
    let better = |it: &Fit| it.robust_cost <= fit.robust_cost;
    let ahead = others.iter().flatten().filter(|it| better(it));
    let behind = others.iter().flatten().filter(|it| !better(it));
    let mut ranked = ahead.chain([&fit]).chain(behind).copied();
    *finalists = std::array::from_fn(|_| ranked.next());
}

/// The `i`-th of the 24 rotations that bring a cube onto itself: one of six faces up, then a quarter turn.
fn rotation_of_cube(i: usize) -> UnitQuaternion<f64> {
    let quarter = std::f64::consts::FRAC_PI_2;
    let about =
        |axis: Vector3<f64>, quarters: usize| UnitQuaternion::from_scaled_axis(axis * quarter * quarters as f64);
    let face = if i < 16 { about(Vector3::x(), i / 4) } else { about(Vector3::y(), i / 4 * 2 - 7) };
    face * about(Vector3::z(), i % 4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_of_the_cube_are_24_different_ones() {
        for i in 0..24 {
            for j in 0..i {
                assert!(rotation_of_cube(i).angle_to(&rotation_of_cube(j)) > 1.5, "{i} {j}");
            }
        }
    }

    #[test]
    fn finalists_are_the_best_of_different_orientations() {
        let fit = |about_x_rad: f64, robust_cost: f64| Fit {
            X_WO: Pose::rotation(Vector3::x() * about_x_rad),
            information: nalgebra::zero(),
            points: 0,
            residual_m: 0.0,
            silhouette_residual_m: None,
            points_mismatch: None,
            silhouette_mismatch: None,
            robust_cost,
            noise_m: 0.0,
            iterations: 0,
        };
        let mut finalists = [None; FINALISTS];
        // The last is a better one of the second.
        for (about_x_rad, cost) in [(0.0, 2.0), (1.0, 3.0), (2.0, 4.0), (3.0, 5.0), (1.0, f64::NAN), (1.0, 1.0)] {
            keep(&mut finalists, fit(about_x_rad, cost), &Symmetry::default());
        }
        let costs: Vec<f64> = finalists.iter().flatten().map(|it| it.robust_cost).collect();
        assert_eq!(costs, [1.0, 2.0, 4.0]);
    }
}
