//! What recorded throws teach about the flights of an object, and how good predictions by it are.
//!
//! Empirical Bayes: the moments of the parameters over the throws by expectation maximization, the noise of the process by the
//! likelihood of where throws ended given what had been seen before.

use catch_bot::trajectory_prediction::{
    TrackSample,
    aerodynamics::{AerodynamicFit, FlightPrior, Noise, PARAMETERS, ParameterCovariance, ParameterVector},
};
use nalgebra::{Unit, Vector3};

/// A recorded throw.
#[derive(Debug, Clone)]
pub struct Throw {
    /// Its samples, in the order of time; two or more.
    pub samples: Vec<TrackSample>,
    /// Direction against which gravity pulls.
    pub up: Unit<Vector3<f64>>,
}

/// How much of a throw is seen before its end is predicted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Seen {
    /// Half of its time.
    Half,
    /// All but that many seconds.
    AllBut(f64),
}

impl Seen {
    /// Those that are reported.
    pub const ALL: [Self; 4] = [Self::Half, Self::AllBut(0.3), Self::AllBut(0.2), Self::AllBut(0.1)];
}

/// A predicted end against the recorded one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Miss {
    /// Distance, in metres.
    pub error_m: f64,
    /// Squared Mahalanobis distance by the predicted covariance.
    pub mahalanobis2: f64,
    /// Logarithm of the covariance's determinant.
    log_determinant: f64,
}

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
const NOISE_THROWS: usize = 24;
/// Degrees of freedom of the robust likelihood: a throw that a hand ended before its last row does not rule the noise.
const STUDENT_DOF: f64 = 6.0;

/// Predicts the end of each throw; `None` where there is no flight.
pub fn misses(throws: &[&Throw], prior: &FlightPrior, seen: Seen) -> Vec<Option<Miss>> {
    in_parallel(throws, prior, |fit, throw| {
        let (first, last) = (throw.samples.first()?, throw.samples.last()?);
        let until_s = match seen {
            Seen::Half => f64::midpoint(first.time_s, last.time_s),
            Seen::AllBut(left_s) => last.time_s - left_s,
        };
        let known = throw.samples.partition_point(|it| it.time_s <= until_s);
        let end = fit.fit(&throw.samples[..known], &throw.up, None).ok()?.at(last.time_s);
        let error = last.position - end.position;
        let factor = end.covariance.fixed_view::<3, 3>(0, 0).into_owned().cholesky()?;
        Some(Miss {
            error_m: error.norm(),
            mahalanobis2: error.dot(&factor.solve(&error)),
            log_determinant: 2.0 * factor.l().diagonal().map(f64::ln).sum(),
        })
    })
}

/// Fits all throws on all cores; results in their order.
fn in_parallel<T: Send>(
    throws: &[&Throw],
    prior: &FlightPrior,
    with: impl Fn(&mut AerodynamicFit, &Throw) -> Option<T> + Sync,
) -> Vec<Option<T>> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let chunk = throws.len().div_ceil(threads).max(1);
    let with = &with;
    std::thread::scope(|scope| {
        let parts: Vec<_> = throws
            .chunks(chunk)
            .map(|part| {
                scope.spawn(move || {
                    let mut fit = AerodynamicFit::new(prior.clone());
                    part.iter().map(|throw| with(&mut fit, throw)).collect::<Vec<_>>()
                })
            })
            .collect();
        parts.into_iter().flat_map(|part| part.join().unwrap_or_default()).collect()
    })
}

/// Learns an object's prior from its throws, beginning with a broad one. `None` where no throw could be fitted.
pub fn learn(throws: &[&Throw], broad: &FlightPrior) -> Option<FlightPrior> {
    let mut prior = broad.clone();
    for _ in 0..ITERATIONS {
        prior = maximized(throws, &prior, broad)?;
    }
    // The noise decides how far the parameters of one throw may be trusted, and so the moments.
    maximized(throws, &with_noise(throws, prior), broad)
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

/// Negative logarithm of the robust likelihood of the throws' ends.
fn surprise(throws: &[&Throw], prior: &FlightPrior) -> f64 {
    let of = |miss: &Miss| {
        0.5 * miss.log_determinant + 0.5 * (STUDENT_DOF + 3.0) * (miss.mahalanobis2 / STUDENT_DOF).ln_1p()
    };
    Seen::ALL.iter().flat_map(|&seen| misses(throws, prior, seen)).flatten().map(|miss| of(&miss)).sum()
}

/// The densities of noise under which the throws' ends surprise least, found by turns.
fn with_noise(throws: &[&Throw], mut prior: FlightPrior) -> FlightPrior {
    let every = throws.len().div_ceil(NOISE_THROWS).max(1);
    let throws: Vec<&Throw> = throws.iter().step_by(every).copied().collect();
    let mut least = surprise(&throws, &prior);
    for step in NOISE_STEPS {
        for _ in 0..NOISE_ROUNDS {
            let before = least;
            for field in [
                (|it| &mut it.acceleration_noise) as fn(&mut FlightPrior) -> &mut f64,
                |it| &mut it.angular_acceleration_noise,
                |it| &mut it.systematic_sd_m,
                |it| &mut it.least_noise.position_sd_m,
            ] {
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
        acceleration_noise: noise(&|it| it.acceleration_noise),
        angular_acceleration_noise: noise(&|it| it.angular_acceleration_noise),
        systematic_sd_m: noise(&|it| it.systematic_sd_m),
        least_noise: Noise {
            position_sd_m: noise(&|it| it.least_noise.position_sd_m),
            orientation_sd_rad: noise(&|it| it.least_noise.orientation_sd_rad),
        },
        ..first.with_moments(&mean, &covariance)
    })
}

/// Prior to begin learning with: any object of hand's size.
pub fn broad() -> FlightPrior {
    let mut prior = FlightPrior {
        source: "any object of a hand's size".into(),
        throws: 0,
        acceleration_noise: 0.1,
        angular_acceleration_noise: 0.5,
        systematic_sd_m: 2e-3,
        least_noise: Noise { position_sd_m: 5e-4, orientation_sd_rad: 3e-3 },
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
