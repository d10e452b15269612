//! Learning of a flight prior from recorded throws of an object, and evaluation of its predictions.
//!
//! Empirical Bayes: the moments of the parameters and the noise of the process over the throws by expectation
//! maximization.

use std::sync::Arc;

use catch_body::free_flight::{PARAMETERS, ParameterVector};
use nalgebra::Matrix3;

use super::{
    flight::Flight,
    flight_misses::{Miss, Misses, Throw, quantile},
    flight_prediction::{predict, predict_near},
    flight_prior::{DRAG_AT, FlightPrior, LIFT_AT, Noise, ParameterCovariance},
};
use crate::parallel;
use catch_body::statistics::median_in_place;

/// Iterations of expectation maximization.
const ITERATIONS: usize = 3;
/// Throws that the first prior counts for in the covariance, and the fraction of its variance that it claims.
const PRIOR_THROWS: f64 = 3.0;
const PRIOR_FRACTION: f64 = 0.01;
/// A throw with fewer sightings that agree than this fraction teaches nothing.
const LEAST_AGREEING: f64 = 0.6;
/// One whose orientations are noisier than most by this factor neither.
const MOST_TIMES: f64 = 4.0;

/// A throw with what a broad prior makes of it: where every fit by a better one begins.
struct Studied<'a> {
    throw: &'a Throw,
    whole: Option<Flight>,
    parts: [Option<Flight>; 4],
}

/// Fits all throws by a broad prior, or those without orientations by the most evident one of any object.
fn studied(throws: &[Throw]) -> Vec<Studied<'_>> {
    let broad = Arc::new(FlightPrior::broad());
    let fitted = parallel::map(throws.len(), |i| {
        let throw = &throws[i];
        let oriented = throw.samples.iter().any(|it| it.rotation.is_some());
        let known = oriented.then(|| broad.clone());
        (throw.flights(known.as_ref(), None), predict(&throw.samples, &throw.up, known).flight)
    });
    throws.iter().zip(fitted).map(|(throw, (parts, whole))| Studied { throw, whole, parts }).collect()
}

/// Learns an object's prior from its throws. `None` where no throw could be fitted.
fn learn(throws: &[&Studied<'_>]) -> Option<FlightPrior> {
    let broad = FlightPrior::broad();
    let known = throws.iter().filter_map(|it| it.whole.as_ref()).collect();
    let mut prior = Arc::new(maximized(known, &broad, &broad)?);
    for _ in 1..ITERATIONS {
        let found = parallel::map(throws.len(), |i| {
            let Studied { throw, whole, .. } = throws[i];
            predict_near(&throw.samples, &throw.up, Some(prior.clone()), whole.as_ref()).flight
        });
        prior = Arc::new(maximized(found.iter().flatten().collect(), &prior, &broad)?);
    }
    Some(calibrated(throws, &prior))
}

/// One iteration of expectation maximization: the moments over all flights with which most sightings agree.
fn maximized(mut found: Vec<&Flight>, prior: &FlightPrior, broad: &FlightPrior) -> Option<FlightPrior> {
    found.retain(|it| it.inliers() as f64 >= LEAST_AGREEING * it.considered() as f64);
    let typical = |of: &dyn Fn(&Flight) -> f64, found: &[&Flight]| {
        median_in_place(&mut found.iter().map(|it| of(it)).collect::<Vec<_>>())
    };
    // Rotations that were not understood teach nothing.
    let most_rad = MOST_TIMES * typical(&|it| it.noise.orientation_sd_rad, &found);
    found.retain(|it| it.noise.orientation_sd_rad <= most_rad);
    let count = found.len() as f64;
    let oriented = found.first()?.oriented;
    let mean = found.iter().map(|it| it.parameters()).sum::<ParameterVector>() / count;
    let spread = |it: &&Flight| {
        let off = it.parameters() - mean;
        it.parameter_covariance() + off * off.transpose()
    };
    let scatter = found.iter().map(spread).sum::<ParameterCovariance>();
    let (_, expected) = broad.moments(oriented);
    let pooled = (scatter + expected * (PRIOR_FRACTION * PRIOR_THROWS)) / (count + PRIOR_THROWS);
    // The mean itself is known only as well as that many throws tell.
    let covariance = pooled * (1.0 + 1.0 / count);
    let (mean, covariance) = with_unmeasured(broad, (mean, (covariance + covariance.transpose()) * 0.5), oriented);
    let density = |square: &dyn Fn(&Flight) -> f64| typical(square, &found).sqrt();
    Some(FlightPrior {
        throws: found.len(),
        acceleration_noise: density(&|it| it.disturbances.0),
        angular_acceleration_noise: if oriented {
            density(&|it| it.disturbances.1)
        } else {
            prior.angular_acceleration_noise
        },
        ..prior.with_moments(&mean, &covariance)
    })
}

/// Moments of the parameters of which tracks with or without orientations say nothing, from a broad prior.
fn with_unmeasured(
    broad: &FlightPrior,
    (mut mean, mut covariance): (ParameterVector, ParameterCovariance),
    oriented: bool,
) -> (ParameterVector, ParameterCovariance) {
    let own = broad.covariance();
    if oriented {
        let lift = own.fixed_view::<3, 3>(LIFT_AT, LIFT_AT).into_owned();
        covariance.fixed_view_mut::<3, 3>(LIFT_AT, LIFT_AT).copy_from(&lift);
        return (mean, covariance);
    }
    // Throws spin about any axis.
    let lift =
        (covariance.fixed_view::<3, 3>(LIFT_AT, LIFT_AT).trace() + mean.fixed_rows::<3>(LIFT_AT).norm_squared()) / 3.0;
    let (drag, variance) = (mean[DRAG_AT], covariance[(DRAG_AT, DRAG_AT)]);
    let by_direction = own.fixed_view::<3, 3>(DRAG_AT, DRAG_AT).into_owned();
    let by_direction = by_direction.add_scalar(-by_direction.sum() / 9.0);
    (mean, covariance) = (broad.mean(), own);
    mean.fixed_rows_mut::<3>(DRAG_AT).fill(drag);
    covariance.fixed_view_mut::<3, 3>(DRAG_AT, DRAG_AT).copy_from(&by_direction.add_scalar(variance));
    covariance.fixed_view_mut::<3, 3>(LIFT_AT, LIFT_AT).fill_diagonal(lift);
    (mean, covariance)
}

/// Shared errors of the sightings that are tried, in metres.
fn systematic_sds_m() -> impl Iterator<Item = f64> {
    std::iter::once(0.0).chain((0..24).map(|i| 5e-4 * 1.2_f64.powi(i)))
}

/// The prior with the smallest shared error of sightings with which the 95 % ellipsoids cover as many of the
/// throws' ends.
///
/// What neighbouring sightings share (markers that are hidden, a body that bends, a hand that touches) is
/// beyond the model; the last row of a recording has it too.
fn calibrated(throws: &[&Studied<'_>], prior: &FlightPrior) -> FlightPrior {
    let bare = Arc::new(FlightPrior { systematic_sd_m: 0.0, ..prior.clone() });
    let misses = misses(throws, &bare);
    let covers = |sd: f64, misses: &[Option<Miss>]| {
        let inside = |miss: &&Miss| miss.measures(sd * sd).0 <= quantile(0.95);
        misses.iter().flatten().filter(inside).count() as f64 >= COVERED * misses.iter().flatten().count() as f64
    };
    let systematic_sd_m = systematic_sds_m().find(|&sd| misses.iter().all(|it| covers(sd, it)));
    let systematic_sd_m = systematic_sd_m.or(systematic_sds_m().last()).unwrap_or_default();
    FlightPrior { systematic_sd_m, ..prior.clone() }
}

/// Fraction of the ends that the 95 % ellipsoid is to cover whatever is seen.
const COVERED: f64 = 0.945;

/// Factor of the standard deviations of an unknown object over those of the known ones.
const UNKNOWN: f64 = 1.5;

/// A prior for any object: as those known, with no direction of the body frame told from another.
fn generic(objects: &[FlightPrior]) -> Option<FlightPrior> {
    let first = objects.first()?;
    let count = objects.len() as f64;
    let average = |of: &dyn Fn(&FlightPrior) -> f64| objects.iter().map(of).sum::<f64>() / count;
    // Mean square of elements around a value, with the variance within each object.
    let square = |elements: std::ops::Range<usize>, around: f64| {
        let size = elements.len() as f64;
        average(&|it| elements.clone().map(|i| (it.mean[i] - around).powi(2) + it.covariance[i][i]).sum::<f64>() / size)
    };
    let drag_of = |it: &FlightPrior| it.mean().fixed_rows::<3>(DRAG_AT).mean();
    let [drag, magnus, decay] = [average(&drag_of), average(&|it| it.mean[9]), average(&|it| it.mean[10])];
    let mut mean = ParameterVector::zeros();
    mean.fixed_rows_mut::<3>(DRAG_AT).fill(drag);
    (mean[9], mean[10]) = (magnus, decay);
    let mut covariance = ParameterCovariance::zeros();
    for (range, around) in [
        (0..3, 0.0),
        (DRAG_AT + 3..9, 0.0),
        (9..10, magnus),
        (10..11, decay),
        (11..LIFT_AT, 0.0),
        (LIFT_AT..PARAMETERS, 0.0),
    ] {
        let variance = square(range.clone(), around);
        range.for_each(|i| covariance[(i, i)] = variance);
    }
    // The drag has a part that all directions share, and one by which they differ.
    let shared = |it: &FlightPrior| it.covariance().fixed_view::<3, 3>(DRAG_AT, DRAG_AT).sum() / 9.0;
    let shared = average(&|it| (drag_of(it) - drag).powi(2) + shared(it));
    let differing = 1.5 * (square(DRAG_AT..DRAG_AT + 3, drag) - shared).max(0.0);
    let mut of_drag = covariance.fixed_view_mut::<3, 3>(DRAG_AT, DRAG_AT);
    of_drag.fill(shared - differing / 3.0);
    of_drag += Matrix3::identity() * differing;
    covariance *= UNKNOWN * UNKNOWN;
    let noise = |of: &dyn Fn(&FlightPrior) -> f64| average(&|it| of(it).powi(2)).sqrt();
    Some(FlightPrior {
        throws: objects.iter().map(|it| it.throws).sum(),
        acceleration_noise: UNKNOWN * noise(&|it| it.acceleration_noise),
        angular_acceleration_noise: UNKNOWN * noise(&|it| it.angular_acceleration_noise),
        systematic_sd_m: noise(&|it| it.systematic_sd_m),
        least_noise: Noise {
            position_sd_m: noise(&|it| it.least_noise.position_sd_m),
            orientation_sd_rad: noise(&|it| it.least_noise.orientation_sd_rad),
        },
        ..first.with_moments(&mean, &covariance)
    })
}

/// Predicted ends of throws by how much was seen.
fn misses(throws: &[&Studied<'_>], prior: &Arc<FlightPrior>) -> Misses {
    let flights = parallel::map(throws.len(), |i| throws[i].throw.flights(Some(prior), Some(&throws[i].parts)));
    let all = throws.iter().zip(&flights);
    std::array::from_fn(|at| all.clone().map(|(it, flights)| it.throw.miss(flights[at].as_ref()?)).collect())
}

/// Predictions of each throw by a prior learned from the other folds; throws go to folds by turns. `None`
/// where nothing could be learned.
fn cross_validated(throws: &[Studied<'_>], folds: usize, progress: &mut impl FnMut()) -> Option<Misses> {
    let mut all = Misses::default();
    for fold in 0..folds {
        let (test, train): (Vec<_>, Vec<_>) = throws.iter().enumerate().partition(|(i, _)| i % folds == fold);
        let [test, train] = [test, train].map(|part| part.into_iter().map(|(_, throw)| throw).collect::<Vec<_>>());
        let prior = Arc::new(learn(&train)?);
        all.iter_mut().zip(misses(&test, &prior)).for_each(|(all, of_fold)| all.extend(of_fold));
        progress();
    }
    Some(all)
}

/// Prior that the throws of objects teach, and how it predicts throws that it was not learned from.
#[derive(Debug)]
pub struct Lessons {
    /// The prior, for any object if there are several.
    pub prior: FlightPrior,
    /// Misses of each object's throws by a prior from its other throws.
    pub own: Vec<Misses>,
    /// Misses of each object's throws by a prior for any object, learned from the others; none of one object.
    pub others: Vec<Misses>,
}

/// Learns from the throws of each of some objects, with cross-validation by `folds`; `progress` is called
/// `folds + 1` times for each.
///
/// # Errors
/// Index of an object whose throws teach nothing.
pub fn lessons(objects: &[Vec<Throw>], folds: usize, mut progress: impl FnMut()) -> Result<Lessons, usize> {
    let objects: Vec<_> = objects.iter().map(|it| studied(it)).collect();
    let (mut priors, mut own) = (Vec::new(), Vec::new());
    for (i, throws) in objects.iter().enumerate() {
        own.push(cross_validated(throws, folds, &mut progress).ok_or(i)?);
        priors.push(learn(&throws.iter().collect::<Vec<_>>()).ok_or(i)?);
        progress();
    }
    let mut others = Vec::new();
    for (i, throws) in objects.iter().enumerate() {
        let rest = [&priors[..i], &priors[i + 1..]].concat();
        let prior = generic(&rest).map(Arc::new);
        others.extend(prior.map(|it| misses(&throws.iter().collect::<Vec<_>>(), &it)));
    }
    let prior = if priors.len() > 1 { generic(&priors) } else { priors.pop() };
    Ok(Lessons { prior: prior.ok_or(0_usize)?, own, others })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_built_in_is_a_prior_and_is_written_as_it_is_read() {
        let prior = FlightPrior::any_object();
        assert!(prior.throws > 0 && prior.source.contains("github.com"), "{}", prior.source);
        prior.check("learned").unwrap();
        FlightPrior::broad().check("broad").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("object.toml");
        std::fs::write(&path, prior.text().unwrap()).unwrap();
        assert_eq!(FlightPrior::read(&path).unwrap(), prior);
        std::fs::write(&path, prior.text().unwrap().replace("throws", "throw")).unwrap();
        assert!(FlightPrior::read(&path).unwrap_err().to_string().contains("throw"));
        let mut wrong = prior;
        wrong.covariance[2][2] = -1.0;
        std::fs::write(&path, wrong.text().unwrap()).unwrap();
        assert!(FlightPrior::read(&path).unwrap_err().to_string().contains("positive definite"));
    }

    #[test]
    fn of_any_object_no_direction_is_told_from_another() {
        let prior = generic(&[FlightPrior::broad(), FlightPrior::any_object()]).unwrap();
        let (mean, covariance) = (prior.mean(), prior.covariance());
        assert_eq!(mean.fixed_rows::<3>(0).norm(), 0.0);
        assert!((mean[3] - mean[5]).abs() < 1e-12 && (covariance[(3, 3)] - covariance[(5, 5)]).abs() < 1e-12);
        assert!(generic(&[]).is_none());
    }
}
