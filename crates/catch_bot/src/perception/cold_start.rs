//! Registration without a prior: from all around.

use catch_body::Pose;
use nalgebra::{Translation3, UnitQuaternion, Vector3};

use super::{
    Config, PerceptionStatus, ReferenceModel, Symmetry,
    point_cloud::SceneCloud,
    registration::{self, Fit},
};

/// Points that the attitudes are compared on: enough to tell them apart.
const TRIAL_POINTS: usize = 100;
/// Steps from each attitude before they are compared.
const TRIAL_ITERATIONS: usize = 7;
/// Attitudes that are then compared on all points.
const FINALISTS: usize = 3;
/// Steps of each before that: the right one is settled by then, or as good as.
const FINAL_ITERATIONS: usize = 5;
/// Attitudes closer than this are one.
const SAME_ATTITUDE_RAD: f64 = 0.3;

/// Registers from each of the 24 rotations of the cube, of which one is within 63° of any attitude, and keeps the best.
///
/// What cannot be observed of the attitude is taken from the prior if there is one.
pub(super) fn register(
    scene: &mut SceneCloud,
    thinned: &mut SceneCloud,
    reference: &ReferenceModel,
    prior: Option<&Pose>,
    config: &Config,
) -> Result<Fit, PerceptionStatus> {
    thinned.thin_from(scene, TRIAL_POINTS);
    let p_WO = Translation3::from(scene.centroid().coords);
    let R_WO = prior.map_or_else(UnitQuaternion::identity, |X_WO| X_WO.rotation);
    let starts = if matches!(reference.symmetry, Symmetry::Sphere) { 1 } else { 24 };

    // With points alone first, unless they are told to be noisy; again with the outline if they turn out to be.
    let mut best: Option<(Fit, bool)> = None;
    for outlined in [false, true] {
        let is_hopeless = !outlined && scene.mean_noise_m() > config.outline_above_m && !scene.outline.is_empty();
        if is_hopeless || outlined && scene.outline.is_empty() {
            continue;
        }
        // The best few on a part of the scene, then the best of these on all of it.
        let mut finalists: [Option<Fit>; FINALISTS] = [None; FINALISTS];
        for i in 0..starts {
            let X_WO = Pose::from_parts(p_WO, rotation_of_cube(i) * R_WO);
            let fit = registration::iterate(thinned, reference, &X_WO, config, TRIAL_ITERATIONS, outlined).0;
            keep(&mut finalists, fit, &reference.symmetry);
        }
        let results = finalists.iter().flatten();
        let results =
            results.map(|fit| registration::iterate(scene, reference, &fit.X_WO, config, FINAL_ITERATIONS, outlined).0);
        let least = results.min_by(|a, b| a.misfit.total_cmp(&b.misfit));
        best = least.map(|fit| (fit, outlined)).or(best);
        if best.is_some_and(|(fit, _)| fit.residual_m <= config.outline_above_m) {
            break;
        }
    }
    let (best, outlined) = best.ok_or(PerceptionStatus::NotConverged)?;
    registration::register(scene, reference, &best.X_WO, config, outlined)
}

/// Keeps the best fits in order, each attitude once.
fn keep(finalists: &mut [Option<Fit>; FINALISTS], fit: Fit, symmetry: &Symmetry) {
    if !fit.misfit.is_finite() {
        return;
    }
    let mut candidate = Some(fit);
    for place in finalists {
        let Some(new) = candidate else { return };
        match place {
            Some(old) if old.misfit <= new.misfit => {
                if symmetry.turn_between(&old.X_WO.rotation, &new.X_WO.rotation).norm() < SAME_ATTITUDE_RAD {
                    return;
                }
            }
            Some(old) if symmetry.turn_between(&old.X_WO.rotation, &new.X_WO.rotation).norm() < SAME_ATTITUDE_RAD => {
                *place = candidate.take();
            }
            _ => std::mem::swap(place, &mut candidate),
        }
    }
}

/// The `i`-th of the 24 rotations that bring a cube onto itself: one of six faces up, then a quarter turn.
fn rotation_of_cube(i: usize) -> UnitQuaternion<f64> {
    let quarter = std::f64::consts::FRAC_PI_2;
    let about =
        |axis: Vector3<f64>, quarters: usize| UnitQuaternion::from_scaled_axis(axis * quarter * quarters as f64);
    let face = match i / 4 {
        up @ 0..=3 => about(Vector3::x(), up),
        4 => about(Vector3::y(), 1),
        _ => about(Vector3::y(), 3),
    };
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
}
