//! Earliest times at which the gripper of an arm that departs from its ready pose can be at each pose.
//!
//! The map is a table over positions (10 cm) and orientations (54 directions of approach, 6 rolls about each)
//! of the gripper, prepared by sampling before anything flies. A search looks poses up before any inverse
//! kinematics. Times count from the departure at rest: a pose within reach of a moving arm is within reach of
//! one that had as long from the departure on, as motions can be joined. The table is no lower bound: samples
//! are finite, so a pose may be reached up to [`SLACK_S`] sooner, and in fewer than two of a thousand cases
//! by more.

mod sampling;

pub use sampling::{CHUNKS, ReachSamples};

use catch_body::{JointVector, Pose, Robot, workcell::FLOOR_Z_M};
use nalgebra::{Point3, Vector3};

use super::{Start, posture::PostureFinder};

/// Edge of a voxel in metres, but for arms whose table would get too large.
const VOXEL_M: f64 = 0.1;
/// Voxels along an edge of the table at most.
const MOST_VOXELS: f64 = 40.0;
/// Directions of approach: nine on each face of a cube. Rolls about each of them.
const DIRECTIONS: usize = 54;
const ROLLS: usize = 6;
const ORIENTATIONS: usize = DIRECTIONS * ROLLS;
/// Unit of the times in seconds, and the latest time that is told from never.
const UNIT_S: f64 = 0.01;
pub(super) const HORIZON_S: f64 = 1.3;
/// Entry of poses that are never reached.
const NEVER: u8 = u8::MAX;
/// A pose that needs this much more than there is may still be reached, in seconds: samples are finite.
pub const SLACK_S: f64 = 0.05;
/// An arm that is no farther from the ready pose than this, in radians, departs from there.
const SAME_RAD: f64 = 0.01;
/// First bytes of a stored map; the number is that of the method and of the format.
const MAGIC: &[u8] = b"reach map 1\n";

/// The least time from the departure at the ready pose until the gripper can be at a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct ReachMap {
    ready_q: JointVector,
    grid: Grid,
    key: Vec<u8>,
    /// Earliest times by corner of the voxels, then orientation: the least of the eight voxels around it.
    times: Vec<u8>,
}

/// Voxels about an arm, their corners the nodes of the table.
#[derive(Debug, Clone, PartialEq)]
struct Grid {
    lowest: Point3<f64>,
    voxel_m: f64,
    /// Numbers of voxels along x, y and z.
    voxels: [usize; 3],
}

impl Grid {
    /// All that the gripper can come to, but for what is below the floor.
    fn of(robot: &Robot) -> Self {
        let reach_m =
            robot.per_joint(|joint| joint.X_PL.translation.vector.norm()).sum() + robot.X_LG.translation.vector.norm();
        let voxel_m = VOXEL_M.max(2.0 * reach_m / MOST_VOXELS);
        let base = robot.X_WB.translation.vector;
        let lowest = base.add_scalar(-reach_m);
        let lowest = Vector3::new(lowest.x, lowest.y, lowest.z.max(FLOOR_Z_M - voxel_m));
        let size = base.add_scalar(reach_m) - lowest;
        let voxels = [size.x, size.y, size.z].map(|it| (it / voxel_m).ceil().max(1.0) as usize);
        Self { lowest: lowest.into(), voxel_m, voxels }
    }

    fn corners(&self) -> [usize; 3] {
        self.voxels.map(|it| it + 1)
    }

    /// The voxel in which a point lies.
    fn voxel(&self, p_W: &Vector3<f64>) -> Option<usize> {
        index((p_W - self.lowest.coords) / self.voxel_m, self.voxels)
    }

    /// The corner that is nearest to a point.
    fn corner(&self, p_W: &Vector3<f64>) -> Option<usize> {
        index(((p_W - self.lowest.coords) / self.voxel_m).add_scalar(0.5), self.corners())
    }
}

/// The number of the node with these coordinates, rounded down.
fn index(at: Vector3<f64>, counts: [usize; 3]) -> Option<usize> {
    let inside = (0..3).all(|axis| (0.0..counts[axis] as f64).contains(&at[axis]));
    inside.then(|| (at.z as usize * counts[1] + at.y as usize) * counts[0] + at.x as usize)
}

/// The number of a gripper's orientation: where on a cube the direction of approach y_G points, and how x_G
/// is rolled about it.
fn orientation(X_WG: &Pose) -> usize {
    let (x, y) = (X_WG.rotation * Vector3::x(), X_WG.rotation * Vector3::y());
    let axis = y.iamax();
    let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
    let third = |i: usize| if 3.0 * y[i].abs() < y[axis].abs() { 1 } else { usize::from(y[i] > 0.0) * 2 };
    let face = 2 * axis + usize::from(y[axis] > 0.0);
    // The roll is counted from the projection of the axis `next`.
    let [across, up] = [x[next], x.dot(&y.cross(&Vector3::ith(next, 1.0)))];
    ((face * 3 + third(next)) * 3 + third(last)) * ROLLS + sextant(across, up)
}

/// Number of the sixth of a turn in which a direction lies, counted from −180° on.
fn sextant(x: f64, y: f64) -> usize {
    let at_60 = x * 3.0_f64.sqrt();
    if y >= 0.0 {
        3 + usize::from(y >= at_60) + usize::from(y <= -at_60)
    } else {
        usize::from(y <= at_60) + usize::from(y >= -at_60)
    }
}

impl ReachMap {
    /// Returns whether a search for `robot` uses a map: its inverse kinematics does not decide at once, over
    /// the whole self-motion, whether a pose can be reached.
    pub fn serves(robot: &Robot) -> bool {
        !matches!(PostureFinder::new(robot), PostureFinder::Srs(_))
    }

    /// Computes the map of an arm that waits at its ready pose, on one thread, which takes some seconds.
    pub fn new(robot: &Robot) -> Self {
        let mut samples = ReachSamples::new(robot);
        (0..CHUNKS).for_each(|chunk| samples.draw(chunk));
        samples.map()
    }

    /// The least time from the departure until the gripper is at `X_WG`, in seconds; infinite if no sample
    /// came there within 1.3 s.
    pub fn least_time_s(&self, X_WG: &Pose) -> f64 {
        let corner = self.grid.corner(&X_WG.translation.vector);
        let time = corner.map_or(NEVER, |corner| self.times[corner * ORIENTATIONS + orientation(X_WG)]);
        if time == NEVER { f64::INFINITY } else { f64::from(time) * UNIT_S }
    }

    /// Returns whether the gripper can be at `X_WG` so long after the departure, as far as samples show.
    pub fn is_in_time(&self, X_WG: &Pose, time_s: f64) -> bool {
        time_s > HORIZON_S - SLACK_S || self.least_time_s(X_WG) <= time_s + SLACK_S
    }

    /// Returns whether an arm in this state has yet to depart from the ready pose.
    pub fn departs_at(&self, start: &Start) -> bool {
        start.state.dq == JointVector::zeros() && (start.state.q - self.ready_q).amax() < SAME_RAD
    }

    /// All that a map depends on: chain, limits, mount and ready pose.
    pub fn key(robot: &Robot) -> Vec<u8> {
        let pose = |it: &Pose| [it.translation.vector.as_slice(), it.rotation.coords.as_slice()].concat();
        let mut key = [pose(&robot.X_WB), pose(&robot.X_LG)].concat();
        for (joint, ready) in robot.joints.iter().zip(&robot.ready_q) {
            let limits = &joint.limits;
            key.extend(pose(&joint.X_PL));
            key.extend(joint.axis.as_slice());
            key.extend([limits.lower, limits.upper, limits.velocity, limits.acceleration, *ready]);
        }
        key.iter().flat_map(|it| it.to_le_bytes()).collect()
    }

    /// The map as bytes, to be stored.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = [MAGIC, &(self.key.len() as u32).to_le_bytes(), &self.key, &self.times].concat();
        let sum = checksum(&bytes);
        bytes.extend(sum.to_le_bytes());
        bytes
    }

    /// The map for `robot` from what was stored; `None` if it is another one's, or damaged.
    pub fn from_bytes(robot: &Robot, bytes: &[u8]) -> Option<Self> {
        let (content, sum) = bytes.split_last_chunk::<8>()?;
        let key = Self::key(robot);
        let times =
            content.strip_prefix(MAGIC)?.strip_prefix(&(key.len() as u32).to_le_bytes()[..])?.strip_prefix(&key[..])?;
        let grid = Grid::of(robot);
        let fits = times.len() == grid.corners().iter().product::<usize>() * ORIENTATIONS;
        let is_whole = fits && checksum(content) == u64::from_le_bytes(*sum);
        is_whole.then(|| Self { ready_q: robot.ready_q, grid, times: times.to_vec(), key })
    }
}

/// FNV-1a (Fowler, Noll, Vo) with 64 bits.
pub fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_sextant_is_that_of_the_angle(degrees in -179.99f64..179.99) {
            let (y, x) = libm::sincos(degrees.to_radians());
            prop_assert_eq!(sextant(x, y), ((degrees + 180.0) / 60.0) as usize);
        }
    }

    #[test]
    fn half_a_turn_is_in_the_last_sextant() {
        assert_eq!(sextant(-1.0, 0.0), ROLLS - 1);
    }
}
