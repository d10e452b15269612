//! Random sample consensus over flights through two poses (paper, III-B; Fischler and Bolles, 1981).

use catch_body::{
    dynamics::gravity,
    free_flight::ballistic::{Law, Motion},
    symmetry::Symmetry,
};
use nalgebra::{Matrix3, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{
    Config, FlightTrajectory, PredictionStatus, WINDOW,
    agreement::{is_finite, is_within, of_position},
    inertia_per_kg,
    rotation_consensus::{Orientation, agree_on_rotation},
};
use crate::perception::ObjectPose;

/// Buffers of the search.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    orientations: Vec<Orientation>,
    /// Information on each pose's position.
    positions: Vec<Matrix3<f64>>,
}

/// Model of a sampled flight's rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rotation {
    /// Rotation of a free rigid body, the one that most poses agree with. Poses agree with a flight by their
    /// positions alone: the shortest rotation between the two poses of a tumbling object is often not the way
    /// it rotated.
    Free,
    /// Rotation at a constant rate by the shortest rotation between its two poses, to which the other poses
    /// must agree (paper).
    Constant,
}

/// Choice among several flights with which equally many poses agree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TieBreak {
    /// The one from which the poses' mean squared distance is the least (the paper's text).
    MeanSquare,
    /// The one from which the sum of their distances in metres and angles in radians is the least (its code).
    Sum,
}

/// Parameters for sampling and comparing flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sampling {
    /// Model of a sampled flight's rotation.
    pub rotation: Rotation,
    /// Choice among flights with equally many inliers.
    pub ties: TieBreak,
    /// Two-pose flights that are sampled at most, [`SAMPLES`] at least.
    pub most: usize,
    /// Seed of the generator that draws them.
    pub seed: u64,
}

/// Two-pose flights that are sampled at least (paper, III-B).
pub const SAMPLES: usize = 20;
/// A pose agrees with a rotation within this angle, in radians (original).
const INLIER_RAD: f64 = 0.1;

impl Sampling {
    /// Sampling of our method: with 40 % outliers one start in 7,000 sees no good pair in 20 samples, so
    /// sampling goes on until a better pair can hardly have been missed.
    pub const OURS: Self = Self { rotation: Rotation::Free, ties: TieBreak::MeanSquare, most: 500, seed: 0 };
}

/// The sampled flight that most poses agree with and, of several, the one they lie closest to.
///
/// # Errors
/// Fewer than two poses, or no two that agree.
pub fn best_flight(
    poses: &[ObjectPose],
    symmetry: &Symmetry,
    Sampling { rotation, ties, most, seed }: Sampling,
    config: &Config,
    scratch: &mut Scratch,
) -> Result<FlightTrajectory, PredictionStatus> {
    if poses.len() < 2 {
        return Err(PredictionStatus::TooFewPoses);
    }
    let Scratch { orientations, positions } = scratch;
    // Room for as many as there will ever be, so that it is made once.
    orientations.clear();
    orientations.reserve(WINDOW);
    positions.clear();
    positions.reserve(WINDOW);
    positions.extend(poses.iter().map(of_position));
    let mut random = Pcg64Mcg::seed_from_u64(seed ^ poses.len() as u64);
    let mut best: Option<(Agreement, FlightTrajectory)> = None;
    for sample in 0..most.max(SAMPLES) {
        if sample >= SAMPLES && best.as_ref().is_some_and(|(it, _)| enough(sample, it.inliers, poses.len())) {
            break;
        }
        let first = random.random_range(0..poses.len());
        let second = (first + random.random_range(1..poses.len())) % poses.len();
        let (from, to) = (first.min(second), first.max(second));
        let Some(flight) = through(&poses[from], &poses[to], symmetry, rotation, config) else { continue };
        let agreement = agreement((poses, positions), &flight, symmetry, rotation);
        if best.as_ref().is_none_or(|(best, _)| agreement.is_better_than(best, ties)) {
            best = Some((agreement, flight));
        }
    }
    let (Agreement { inliers, mean_square_m2, .. }, mut flight) = best.ok_or(PredictionStatus::NoAgreement)?;
    if inliers < 2 {
        return Err(PredictionStatus::NoAgreement);
    }
    if rotation == Rotation::Free {
        each_position((poses, positions), &flight, |(pose, information), p_WO| {
            if is_finite(pose) && is_within(&(pose.X_WO.translation.vector - p_WO), information) {
                orientations.push(Orientation::of(pose));
            }
        });
        agree_on_rotation(orientations, &mut flight, symmetry, config);
    }
    // Estimate of its uncertainty without a fit: two points, each as far off as the inliers on average.
    let variance = mean_square_m2 / 3.0;
    let seen_s = (poses[poses.len() - 1].capture_s - poses[0].capture_s).abs().max(1e-3);
    for i in 0..3 {
        flight.covariance[(i, i)] = variance;
        flight.covariance[(i + 3, i + 3)] = 2.0 * variance / (seen_s * seen_s);
    }
    flight.inliers = inliers;
    flight.considered = poses.len();
    Ok(flight)
}

/// Probability that sampling stops before it has seen a pair of inliers.
const MISS: f64 = 1e-6;

/// Returns whether `samples` pairs are enough when a fraction w of the poses agrees with the best: (1 −
/// w²)^samples ≤ [`MISS`].
fn enough(samples: usize, inliers: usize, poses: usize) -> bool {
    let fraction = inliers as f64 / poses as f64;
    samples as f64 * libm::log(1.0 - fraction * fraction) <= libm::log(MISS)
}

/// The flight through two poses, at the time of the later one: p₂ = p₁ + v₁Δt + ½gΔt², shortened by the drag
/// that is expected, and the shortest turn between the orientations.
fn through(
    earlier: &ObjectPose,
    later: &ObjectPose,
    symmetry: &Symmetry,
    rotation: Rotation,
    config: &Config,
) -> Option<FlightTrajectory> {
    let elapsed_s = later.capture_s - earlier.capture_s;
    if elapsed_s.is_nan() || elapsed_s <= 1e-6 {
        return None;
    }
    let (p1, p2) = (earlier.X_WO.translation.vector, later.X_WO.translation.vector);
    let mut v_WOcm = (p2 - p1) / elapsed_s + gravity() * (0.5 * elapsed_s);
    if config.drag_per_m() != 0.0 {
        // Flown backwards from the later pose, the flight must meet the earlier one.
        for _ in 0..3 {
            let missed = Motion::new(p2, v_WOcm).after(-elapsed_s, &Law::with_drag(config.drag_per_m()), false).p - p1;
            v_WOcm += missed / elapsed_s;
        }
    }
    let w_WO = symmetry.turn_between(&earlier.X_WO.rotation, &later.X_WO.rotation) / elapsed_s;
    let flight = FlightTrajectory {
        time_s: later.capture_s,
        p_WOcm: Point3::from(p2),
        v_WOcm,
        R_WO: later.X_WO.rotation,
        w_WO,
        drag_per_m: config.drag_per_m(),
        spin_decay_per_s: config.aerodynamics.spin_decay_per_s,
        inertia_per_kg: inertia_per_kg(symmetry).filter(|_| rotation == Rotation::Free),
        systematic_sd_m: config.systematic_sd_m,
        process_noise: config.process_noise,
        inliers: 2,
        considered: 2,
        error_scale: 1.0,
        ..FlightTrajectory::default()
    };
    (v_WOcm.iter().chain(w_WO.iter()).all(|value| value.is_finite())).then_some(flight)
}

/// Poses, and the information on the position of each.
type Seen<'a> = (&'a [ObjectPose], &'a [Matrix3<f64>]);

/// Calls `visit` with each pose and where the flight is then, pose after pose.
fn each_position<'a>(
    (poses, positions): Seen<'a>,
    flight: &FlightTrajectory,
    mut visit: impl FnMut((&'a ObjectPose, &'a Matrix3<f64>), &Vector3<f64>),
) {
    let mut motion = Motion::new(flight.p_WOcm.coords, flight.v_WOcm);
    let mut time_s = flight.time_s;
    for (pose, position) in poses.iter().zip(positions) {
        let elapsed_s = pose.capture_s - time_s;
        if elapsed_s.is_finite() {
            motion = motion.after(elapsed_s, &Law::with_drag(flight.drag_per_m), false);
            time_s = pose.capture_s;
        }
        visit((pose, position), &motion.p);
    }
}

/// Agreement of poses with a flight.
struct Agreement {
    /// Number of poses that do.
    inliers: usize,
    /// Mean squared distance of these poses from the flight.
    mean_square_m2: f64,
    /// Sum of their distances in metres and angles in radians.
    sum: f64,
}

impl Agreement {
    fn is_better_than(&self, other: &Self, ties: TieBreak) -> bool {
        let is_nearer = match ties {
            TieBreak::MeanSquare => self.mean_square_m2 < other.mean_square_m2,
            TieBreak::Sum => self.sum < other.sum,
        };
        self.inliers > other.inliers || self.inliers == other.inliers && is_nearer
    }
}

/// Agreement of poses with a flight; the rotation counts where it is constant.
fn agreement(seen: Seen<'_>, flight: &FlightTrajectory, symmetry: &Symmetry, rotation: Rotation) -> Agreement {
    let (mut inliers, mut squares, mut sum) = (0, 0.0, 0.0);
    each_position(seen, flight, |(pose, information), p_WO| {
        let off_m = pose.X_WO.translation.vector - p_WO;
        if !is_within(&off_m, information) {
            return;
        }
        let distance = off_m.norm();
        let angle_rad = match rotation {
            Rotation::Free => 0.0,
            Rotation::Constant => {
                let R_WO = flight.pose_at(pose.capture_s).rotation;
                symmetry.turn_between(&R_WO, &pose.X_WO.rotation).norm()
            }
        };
        if rotation == Rotation::Free || angle_rad < INLIER_RAD {
            inliers += 1;
            squares += distance * distance;
            sum += distance + angle_rad;
        }
    });
    Agreement { inliers, mean_square_m2: squares / inliers.max(1) as f64, sum }
}
