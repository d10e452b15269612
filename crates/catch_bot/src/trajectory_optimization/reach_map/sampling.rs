//! Samples of what an arm can reach: joint positions drawn from what all joints can reach within a time, and
//! the pose of the gripper there.
//!
//! What counts is the time of the joint that takes longest. The samples come in chunks with a random stream
//! each, and of two samples of one pose the earlier stays: the map is the same in whatever order the chunks
//! are drawn, by however many threads.

use catch_body::{JointVector, MAX_JOINTS, Robot};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::{Grid, HORIZON_S, NEVER, ORIENTATIONS, ReachMap, UNIT_S, orientation};
use crate::trajectory_optimization::reachability::ReachableSet;

/// Chunks of a map, and samples of each: some ten of each pose that can be reached.
pub const CHUNKS: u64 = 1200;
const SAMPLES: usize = 10_000;
/// Exponent that spreads the samples over time: the later, the more poses there are to be found.
const SPREAD: f64 = 0.4;

/// Earliest times found so far.
#[derive(Debug, Clone)]
pub struct ReachSamples<'a> {
    robot: &'a Robot,
    grid: Grid,
    /// Earliest times by voxel, then orientation.
    times: Vec<u8>,
}

impl<'a> ReachSamples<'a> {
    /// Creates the table without samples.
    pub fn new(robot: &'a Robot) -> Self {
        let grid = Grid::of(robot);
        let times = vec![NEVER; grid.voxels.iter().product::<usize>() * ORIENTATIONS];
        Self { robot, grid, times }
    }

    /// Draws the samples of one of the [`CHUNKS`].
    pub fn draw(&mut self, chunk: u64) {
        let mut rng = Pcg64::seed_from_u64(chunk);
        for _ in 0..SAMPLES {
            let within_s = HORIZON_S * libm::pow(rng.random::<f64>(), SPREAD);
            let (mut q, mut time_s) = ([0.0; MAX_JOINTS], 0.0_f64);
            for (i, joint) in self.robot.joints.iter().enumerate() {
                let (limits, from) = (&joint.limits, self.robot.ready_q[i]);
                let set = ReachableSet {
                    start_velocity: 0.0,
                    velocity: limits.velocity,
                    acceleration: limits.acceleration,
                    time_s: within_s,
                };
                let far = set.displacements().high;
                let [low, high] = [(from - far).max(limits.lower), (from + far).min(limits.upper)];
                q[i] = low + (high - low) * rng.random::<f64>();
                time_s = time_s.max(set.least_time_s(q[i] - from));
            }
            let X_WG = self.robot.gripper_pose(&JointVector::from(q));
            if let Some(voxel) = self.grid.voxel(&X_WG.translation.vector) {
                let known = &mut self.times[voxel * ORIENTATIONS + orientation(&X_WG)];
                *known = (*known).min((time_s / UNIT_S) as u8);
            }
        }
    }

    /// Combines the results of both: the earlier time of each pose.
    pub fn merged(mut self, other: &Self) -> Self {
        least(&mut self.times, &other.times);
        self
    }

    /// The map that they make.
    pub fn map(self) -> ReachMap {
        let (corners, voxels) = (self.grid.corners(), self.grid.voxels);
        let mut times = vec![NEVER; corners.iter().product::<usize>() * ORIENTATIONS];
        let number = |at: [usize; 3], of: [usize; 3]| (at[2] * of[1] + at[1]) * of[0] + at[0];
        for z in 0..voxels[2] {
            for y in 0..voxels[1] {
                for x in 0..voxels[0] {
                    let voxel = number([x, y, z], voxels) * ORIENTATIONS;
                    let found = &self.times[voxel..][..ORIENTATIONS];
                    for i in 0..8 {
                        let corner = number([x + i % 2, y + i / 2 % 2, z + i / 4], corners) * ORIENTATIONS;
                        least(&mut times[corner..][..ORIENTATIONS], found);
                    }
                }
            }
        }
        ReachMap { ready_q: self.robot.ready_q, grid: self.grid, key: ReachMap::key(self.robot), times }
    }
}

fn least(known: &mut [u8], found: &[u8]) {
    known.iter_mut().zip(found).for_each(|(known, found)| *known = (*known).min(*found));
}
