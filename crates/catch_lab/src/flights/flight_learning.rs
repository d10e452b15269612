//! What recorded throws teach about the flights of an object, and how good predictions by it are.
//!
//! Empirical Bayes: the moments of the parameters over the throws by expectation maximization, the noise of the process by the
//! likelihood of where throws ended given what had been seen before.

use std::path::Path;

use catch_body::InputError;

use super::aerodynamics::{FlightPrior, Noise, PARAMETERS, ParameterCovariance, ParameterVector};
use super::flight_misses::{Miss, Misses, Seen, Throw, in_parallel, misses, quantile};
use catch_recording::bounded_file::FileKind;

/// Iterations of expectation maximization.
const ITERATIONS: usize = 3;
/// Throws that the first prior counts for in the covariance, and the fraction of its variance that it claims.
const PRIOR_THROWS: f64 = 3.0;
const PRIOR_FRACTION: f64 = 0.01;
/// A throw with fewer samples that agree than this fraction teaches nothing.
const LEAST_AGREEING: f64 = 0.6;
/// Steps of the search for the densities of noise, as factors, and rounds of it at most.
const NOISE_STEPS: [f64; 2] = [2.0, 1.4];
const NOISE_ROUNDS: usize = 3;
/// Throws that the search looks at, at most.
const NOISE_THROWS: usize = 16;
/// Degrees of freedom of the robust likelihood: a throw that a hand ended before its last row does not rule the noise.
const STUDENT_DOF: f64 = 6.0;

/// Learns an object's prior from its throws, beginning with a broad one. `None` where no throw could be fitted.
pub fn learn(throws: &[&Throw], broad: &FlightPrior) -> Option<FlightPrior> {
    let mut prior = broad.clone();
    for _ in 0..ITERATIONS {
        prior = maximized(throws, &prior, broad)?;
    }
    // The noise decides how far the parameters of one throw may be trusted, and so the moments.
    let prior = maximized(throws, &with_noise(throws, prior), broad)?;
    Some(calibrated(throws, prior))
}

/// One iteration of expectation maximization: the moments of the parameters over all throws.
fn maximized(throws: &[&Throw], prior: &FlightPrior, broad: &FlightPrior) -> Option<FlightPrior> {
    let found = in_parallel(throws, prior, |fit, throw| {
        let flight = fit.fit(&throw.samples, &throw.up, None).ok()?;
        let agrees = flight.inliers as f64 >= LEAST_AGREEING * flight.considered as f64;
        (flight.converged && agrees).then(|| (flight.parameters(), flight.parameter_covariance()))
    });
    let found: Vec<_> = found.into_iter().flatten().collect();
    if found.is_empty() {
        return None;
    }
    let count = found.len() as f64;
    let mean = found.iter().map(|(mean, _)| mean).sum::<ParameterVector>() / count;
    let spread = |(of, own): &(ParameterVector, ParameterCovariance)| own + (of - mean) * (of - mean).transpose();
    let scatter = found.iter().map(spread).sum::<ParameterCovariance>();
    let pooled = (scatter + broad.covariance() * (PRIOR_FRACTION * PRIOR_THROWS)) / (count + PRIOR_THROWS);
    // The mean itself is known only as well as that many throws tell.
    let covariance = pooled * (1.0 + 1.0 / count);
    Some(FlightPrior {
        throws: found.len(),
        ..prior.with_moments(&mean, &((covariance + covariance.transpose()) * 0.5))
    })
}

/// Shared errors of the samples that are tried, in metres.
fn systematic_sds_m() -> impl Iterator<Item = f64> {
    (0..24).map(|i| 5e-4 * 1.2_f64.powi(i))
}

/// Negative logarithm of the robust likelihood of the throws' ends under the most likely error that samples share; a throw
/// that cannot be fitted surprises as much under any noise.
fn surprise(throws: &[&Throw], prior: &FlightPrior) -> f64 {
    let prior = FlightPrior { systematic_sd_m: 0.0, ..prior.clone() };
    let misses: Vec<Miss> = Seen::ALL.iter().flat_map(|&seen| misses(throws, &prior, seen)).flatten().collect();
    let of = |miss: &Miss, variance: f64| {
        let (square, log_determinant) = miss.measures(variance);
        0.5 * log_determinant + 0.5 * (STUDENT_DOF + 3.0) * (square / STUDENT_DOF).ln_1p()
    };
    let sum = |sd: f64| misses.iter().map(|miss| of(miss, sd * sd)).sum::<f64>();
    systematic_sds_m().map(sum).fold(f64::INFINITY, f64::min)
}

/// The densities of noise under which the throws' ends surprise least, found by turns.
fn with_noise(throws: &[&Throw], mut prior: FlightPrior) -> FlightPrior {
    let every = throws.len().div_ceil(NOISE_THROWS).max(1);
    let throws: Vec<&Throw> = throws.iter().step_by(every).copied().collect();
    let mut least = surprise(&throws, &prior);
    for step in NOISE_STEPS {
        for _ in 0..NOISE_ROUNDS {
            let before = least;
            for field in [(|it| &mut it.acceleration_noise) as fn(&mut FlightPrior) -> &mut f64, |it| {
                &mut it.angular_acceleration_noise
            }] {
                for factor in [step, 1.0 / step] {
                    let mut other = prior.clone();
                    *field(&mut other) *= factor;
                    let surprise = surprise(&throws, &other);
                    if surprise < least {
                        (prior, least) = (other, surprise);
                        break;
                    }
                }
            }
            if least >= before {
                break;
            }
        }
    }
    prior
}

/// The prior with the smallest shared error of samples with which the 95 % ellipsoids cover as many of the throws' ends.
///
/// What neighbouring samples share (markers that are hidden, a body that bends, a hand that touches) is beyond the model; the
/// last row of a recording has it too.
fn calibrated(throws: &[&Throw], prior: FlightPrior) -> FlightPrior {
    let bare = FlightPrior { systematic_sd_m: 0.0, ..prior };
    let misses = Seen::ALL.map(|seen| misses(throws, &bare, seen));
    let covers = |sd: f64, misses: &[Option<Miss>]| {
        let inside = |miss: &&Miss| miss.measures(sd * sd).0 <= quantile(0.95);
        misses.iter().flatten().filter(inside).count() as f64 >= COVERED * misses.iter().flatten().count() as f64
    };
    let systematic_sd_m = systematic_sds_m().find(|&sd| misses.iter().all(|it| covers(sd, it)));
    FlightPrior { systematic_sd_m: systematic_sd_m.or(systematic_sds_m().last()).unwrap_or_default(), ..bare }
}

/// Fraction of the ends that the 95 % ellipsoid is to cover whatever is seen.
const COVERED: f64 = 0.945;

/// How much further an unknown object may be from those known than these are from each other.
const UNKNOWN: f64 = 1.5;

/// A prior for any object: as those known, with no direction of the body frame told from another.
pub fn generic(objects: &[FlightPrior]) -> Option<FlightPrior> {
    let first = objects.first()?;
    let count = objects.len() as f64;
    let average = |of: &dyn Fn(&FlightPrior) -> f64| objects.iter().map(of).sum::<f64>() / count;
    // Mean square of elements around a value, with the variance within each object.
    let square = |elements: std::ops::Range<usize>, around: f64| {
        let size = elements.len() as f64;
        average(&|it| elements.clone().map(|i| (it.mean[i] - around).powi(2) + it.covariance[i][i]).sum::<f64>() / size)
    };
    let drag = average(&|it| it.mean[3..6].iter().sum::<f64>() / 3.0);
    let magnus = average(&|it| it.mean[9]);
    let decay = average(&|it| it.mean[10]);
    let mut mean = ParameterVector::zeros();
    mean.fixed_rows_mut::<3>(3).fill(drag);
    mean[9] = magnus;
    mean[10] = decay;
    let widened = UNKNOWN * UNKNOWN;
    let mut covariance = ParameterCovariance::zeros();
    let mut fill = |range: std::ops::Range<usize>, variance: f64| {
        range.for_each(|i| covariance[(i, i)] = widened * variance);
    };
    fill(0..3, square(0..3, 0.0));
    fill(3..6, square(3..6, drag));
    fill(6..9, square(6..9, 0.0));
    fill(9..10, square(9..10, magnus));
    fill(10..11, square(10..11, decay));
    fill(11..PARAMETERS, square(11..PARAMETERS, 0.0));
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

/// Predictions of each throw by a prior learned from the other folds; throws go to folds by turns. `None` where nothing could
/// be learned.
pub fn cross_validated(throws: &[Throw], folds: usize, mut progress: impl FnMut()) -> Option<Misses> {
    let mut all = Misses::default();
    for fold in 0..folds {
        let (test, train): (Vec<_>, Vec<_>) = throws.iter().enumerate().partition(|(i, _)| i % folds == fold);
        let [test, train] = [test, train].map(|part| part.into_iter().map(|(_, throw)| throw).collect::<Vec<_>>());
        let prior = learn(&train, &broad())?;
        for (misses_of, seen) in all.iter_mut().zip(Seen::ALL) {
            misses_of.extend(misses(&test, &prior, seen));
        }
        progress();
    }
    Some(all)
}

/// Predictions of the throws of one object by a prior for any object, learned from the others.
pub fn left_out(throws: &[Throw], others: &[FlightPrior]) -> Option<Misses> {
    let (prior, throws) = (generic(others)?, throws.iter().collect::<Vec<_>>());
    Some(Seen::ALL.map(|seen| misses(&throws, &prior, seen)))
}

/// Reads what was learned of an object.
///
/// # Errors
/// A file that cannot be read, or numbers that are no prior.
pub fn read(path: &Path) -> Result<FlightPrior, InputError> {
    let file = path.display().to_string();
    let expected = "a file that `catchingbot learn` has written";
    let text = FileKind::toml(expected).read_text(path)?;
    let prior: FlightPrior = InputError::parse_toml(&file, &text)
        .map_err(|fault| InputError { expected: format!("{}, as in {expected}", fault.expected), ..fault })?;
    prior.check(&file)?;
    Ok(prior)
}

/// Text of a file for [`read`].
///
/// # Errors
/// Never, for numbers that are finite.
pub fn text(prior: &FlightPrior) -> Result<String, toml::ser::Error> {
    Ok(format!("{HEADER}{}", toml::to_string(prior)?))
}

const HEADER: &str = "\
# Flights of an object, for `catchingbot predict --object`; written by `catchingbot learn`.
# Parameters in this order: tracked point from the centre of mass in the body frame (x, y, z; m), drag matrix
# (xx, yy, zz, xy, xz, yz; 1/m), Magnus coefficient, decay of the spin (1/s), logarithm of the inertia tensor
# (xx, yy, xy, xz, yz; traceless).
";

/// The built-in prior for any object.
pub fn any_object() -> FlightPrior {
    toml::from_str(ANY_OBJECT).unwrap_or_else(|_| broad())
}

const ANY_OBJECT: &str = include_str!("../../../../assets/flights/any_object.toml");

/// Prior to begin learning with: any object of hand's size.
pub fn broad() -> FlightPrior {
    let mut prior = FlightPrior {
        source: "any object of a hand's size".into(),
        throws: 0,
        acceleration_noise: 0.1,
        angular_acceleration_noise: 0.5,
        systematic_sd_m: 2e-3,
        least_noise: Noise { position_sd_m: 3e-4, orientation_sd_rad: 2e-3 },
        mean: [0.0; PARAMETERS],
        covariance: [[0.0; PARAMETERS]; PARAMETERS],
    };
    let sds = [0.02, 0.05, 0.05, 0.01, 0.3, 0.7];
    for i in 0..PARAMETERS {
        let kind = [3, 6, 9, 10, 11].iter().filter(|&&first| i >= first).count();
        prior.covariance[i][i] = f64::powi(sds[kind], 2);
    }
    prior.mean[3..6].fill(0.06);
    prior.mean[10] = 0.1;
    prior
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_built_in_is_a_prior_and_is_written_as_it_is_read() {
        let prior = any_object();
        assert!(prior.throws > 0 && prior.source.contains("github.com"), "{}", prior.source);
        prior.check("learned").unwrap();
        broad().check("broad").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("object.toml");
        std::fs::write(&path, text(&prior).unwrap()).unwrap();
        assert_eq!(read(&path).unwrap(), prior);
        std::fs::write(&path, text(&prior).unwrap().replace("throws", "throw")).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("throw"));
        let mut wrong = prior;
        wrong.covariance[2][2] = -1.0;
        std::fs::write(&path, text(&wrong).unwrap()).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("positive definite"));
    }

    #[test]
    fn of_any_object_no_direction_is_told_from_another() {
        let prior = generic(&[broad(), any_object()]).unwrap();
        let (mean, covariance) = (prior.mean(), prior.covariance());
        assert_eq!(mean.fixed_rows::<3>(0).norm(), 0.0);
        assert!((mean[3] - mean[5]).abs() < 1e-12 && (covariance[(3, 3)] - covariance[(5, 5)]).abs() < 1e-12);
        assert!(generic(&[]).is_none());
    }
}
