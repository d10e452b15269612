//! Postures: the joint positions in which the gripper is at a given pose, over the arm's whole redundancy.
//!
//! S-R-S arms have them in closed form, as arcs of swivel angles on which every joint is within its range; nothing is lost
//! between samples. Arms of six joints with three parallel axes have at most eight, in closed form too, and other arms of seven with a
//! spherical shoulder at most eight for each angle of the last joint, which is sampled. Other arms have them by iteration: from where
//! the arm is and from the middle of what it can reach, or, where that did not do, from more starts and along the null space.

use std::f64::consts::{PI, TAU};

use catch_body::{
    JointVector, MAX_JOINTS, Pose, Robot,
    inverse_kinematics::{ALL_BRANCHES, BRANCHES, Branch, ElbowCircle, ParallelAxesArm, SphericalShoulderArm, SrsArm},
};

/// Swivel angles that are looked at in each arc, as fractions of it.
const FRACTIONS_OF_ARC: [f64; 5] = [0.5, 0.25, 0.75, 0.05, 0.95];

/// Angles of the last joint that are looked at in a part of its range, and the parts: the whole, or in a thorough search quarters.
/// Of each part and branch one posture is kept.
const LAST_JOINT_SAMPLES: usize = 10;
const THOROUGH_PARTS: usize = 4;
/// How far samples may be out of a range, as a fraction of it, and still lead to what is within; how often the search for it narrows its interval.
const NEARLY: f64 = 0.25;
const NARROWINGS: usize = 1;
const GOLDEN_SECTION: f64 = 0.381_966;

/// Where the elbow of an S-R-S arm stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elbow {
    /// Which of the eight solutions.
    pub branch: Branch,
    /// Swivel angle.
    pub swivel: f64,
    /// The arc of swivel angles in which it was found.
    pub arc: [f64; 2],
}

/// Joint positions, and how the redundancy is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Posture {
    /// Joint positions.
    pub q: JointVector,
    /// For S-R-S arms.
    pub elbow: Option<Elbow>,
}

/// The arm's way of finding postures.
#[derive(Debug)]
pub enum PostureFinder {
    /// In closed form, all over the redundancy.
    Srs(SrsArm),
    /// In closed form, without redundancy.
    ParallelAxes(ParallelAxesArm),
    /// In closed form for each angle of the last joint.
    SphericalShoulder(SphericalShoulderArm),
    /// By iteration from several starts.
    Numerical,
}

/// Lowest and highest position of every joint.
pub type Ranges = [[f64; 2]; MAX_JOINTS];

impl PostureFinder {
    /// For an arm.
    pub fn new(robot: &Robot) -> Self {
        let srs = SrsArm::of(robot).map(Self::Srs);
        let closed = srs.or_else(|| ParallelAxesArm::of(robot).map(Self::ParallelAxes));
        let closed = closed.or_else(|| SphericalShoulderArm::of(robot).map(Self::SphericalShoulder));
        closed.unwrap_or(Self::Numerical)
    }

    /// Whether it tells of all redundancy at once.
    pub fn covers_redundancy(&self) -> bool {
        matches!(self, Self::Srs(_))
    }

    /// What it takes to look for the postures of a pose, in the units of the search's work.
    pub fn work(&self, thorough: bool) -> usize {
        match (self, thorough) {
            (Self::Srs(_) | Self::ParallelAxes(_), _) => 1,
            (Self::SphericalShoulder(_), false) => 5,
            (Self::SphericalShoulder(_), true) => 20,
            (Self::Numerical, false) => 4,
            (Self::Numerical, true) => 40,
        }
    }

    /// Whether the gripper may hold an object at `X_WO` by a grasp at `X_OG` at all, as far as that is quick to tell.
    pub fn may_reach(&self, X_WO: &Pose, ranges: &Ranges) -> impl Fn(&Pose) -> bool + use<> {
        let near = match self {
            Self::Srs(srs) => {
                let shoulder_O = X_WO.inverse_transform_point(&srs.shoulder());
                Some((shoulder_O, srs.wrist_in_gripper(), srs.wrist_distances_squared(ranges[3])))
            }
            Self::ParallelAxes(_) | Self::SphericalShoulder(_) | Self::Numerical => None,
        };
        move |X_OG| {
            near.is_none_or(|(shoulder_O, wrist_G, [least, most])| {
                (least..=most).contains(&(X_OG * wrist_G - shoulder_O).norm_squared())
            })
        }
    }

    /// Postures within `ranges`, from all over the redundancy; where they take iterations only if the search is `thorough`, else the
    /// ones that few starts find.
    pub fn postures(
        &self,
        robot: &Robot,
        X_WG: &Pose,
        from: &JointVector,
        ranges: &Ranges,
        thorough: bool,
    ) -> Vec<Posture> {
        let alone = |q| Posture { q, elbow: None };
        let srs = match self {
            Self::Srs(srs) => srs,
            Self::ParallelAxes(arm) => return arm.solutions(X_WG, from, ranges).iter().copied().map(alone).collect(),
            Self::SphericalShoulder(arm) => {
                let parts = if thorough { THOROUGH_PARTS } else { 1 };
                return (0..parts)
                    .flat_map(|part| easiest(arm, X_WG, from, ranges, (part, parts)))
                    .map(alone)
                    .collect();
            }
            Self::Numerical => {
                let find = if thorough { Robot::solutions_within } else { Robot::first_solutions_within };
                return find(robot, X_WG, from, ranges).into_iter().map(alone).collect();
            }
        };
        let Some(circle) = srs.elbow_circle(X_WG) else { return Vec::new() };
        let arcs = srs.swivels(&circle, &first_seven(ranges));
        let mut found = Vec::with_capacity(arcs.len() * FRACTIONS_OF_ARC.len());
        for (branch, arc) in arcs {
            found.extend(FRACTIONS_OF_ARC.map(|fraction| {
                posture_at(srs, &circle, Elbow { branch, arc, swivel: arc[0] + fraction * (arc[1] - arc[0]) })
            }));
        }
        found
    }

    /// `known` for a pose that has changed a little: the elbow, or what the null space moves, moved by `by` radians; `None` where
    /// nothing is free to move.
    pub fn adjusted(&self, robot: &Robot, X_WG: &Pose, known: &Posture, by: f64) -> Option<Posture> {
        match (self, known.elbow) {
            (Self::Srs(srs), Some(elbow)) => {
                let circle = srs.elbow_circle(X_WG)?;
                // Close to a singularity the nearest solution may be of another branch.
                let each = Branch::ALL
                    .map(|branch| posture_at(srs, &circle, Elbow { branch, swivel: elbow.swivel + by, ..elbow }));
                let far = |it: &Posture| (it.q - known.q).norm();
                each.into_iter().min_by(|a, b| far(a).total_cmp(&far(b)))
            }
            _ => {
                let ranges = std::array::from_fn(|i| {
                    robot.joints.get(i).map_or([0.0; 2], |joint| [joint.limits.lower, joint.limits.upper])
                });
                let along = if by == 0.0 { JointVector::zeros() } else { robot.self_motion(&known.q)? };
                let q = robot.nearby_solution(X_WG, &(known.q + along * by), &ranges)?;
                Some(Posture { q, elbow: None })
            }
        }
    }

    /// The posture with the elbow elsewhere on its arc, `None` where there is no elbow to move.
    pub fn moved(&self, X_WG: &Pose, posture: &Posture, swivel: f64) -> Option<Posture> {
        let (Self::Srs(srs), Some(elbow)) = (self, posture.elbow) else { return None };
        let swivel = swivel.clamp(elbow.arc[0], elbow.arc[1]);
        Some(posture_at(srs, &srs.elbow_circle(X_WG)?, Elbow { swivel, ..elbow }))
    }
}

/// Of each branch the posture that leaves the joints most room within `ranges`, the last joint being in one of so many parts of its
/// range: the best sample, or, where none is quite within but one between them may be, what a golden-section search finds there.
fn easiest(
    arm: &SphericalShoulderArm,
    X_WG: &Pose,
    from: &JointVector,
    ranges: &Ranges,
    (part, parts): (usize, usize),
) -> impl Iterator<Item = JointVector> {
    // What is more than half a turn away is nearer the other way round, where that is within the range.
    let [low, high] = match ranges[6] {
        [low, high] if high - low > TAU => {
            let low = (from[6] - PI).clamp(low, high - TAU);
            [low, low + TAU]
        }
        range => range,
    };
    let nearly = ranges.map(|[low, high]| [low - NEARLY * (high - low), high + NEARLY * (high - low)]);
    let each = |q7: f64, wanted: u8, found: &mut dyn FnMut(usize, Room)| {
        arm.for_each_solution(X_WG, q7, from, &nearly, wanted, |branch, q| {
            let used = |i: usize| ((2.0 * q[i] - ranges[i][0] - ranges[i][1]) / (ranges[i][1] - ranges[i][0])).abs();
            found(branch, Room { used: (0..6).map(used).fold(0.0, f64::max), q });
        });
    };
    let step = (high - low) / (parts * LAST_JOINT_SAMPLES) as f64;
    let mut best = [const { None::<Room> }; BRANCHES];
    let mut used = [[f64::INFINITY; LAST_JOINT_SAMPLES]; BRANCHES];
    for sample in (0..LAST_JOINT_SAMPLES).filter(|_| low <= high) {
        let q7 = low + step * ((part * LAST_JOINT_SAMPLES + sample) as f64 + 0.5);
        each(q7, ALL_BRANCHES, &mut |branch, room| {
            used[branch][sample] = room.used;
            room.improve(&mut best[branch]);
        });
    }
    for (branch, best) in best.iter_mut().enumerate() {
        let Some(Room { q, .. }) = best.filter(|it| it.used > 1.0 && may_be_within(&used[branch])) else { continue };
        let within = [q[6] - step, q[6] + step].map(|it| it.clamp(low, high));
        golden_section_search(within, |q7| {
            let mut used = f64::INFINITY;
            each(q7, 1 << branch, &mut |_, room| {
                used = room.used;
                room.improve(best);
            });
            used
        });
    }
    best.into_iter().flatten().filter(|room| room.used <= 1.0).map(|room| room.q)
}

/// Looks where a function is low between two ends, a few times.
fn golden_section_search([mut low, mut high]: [f64; 2], mut value_at: impl FnMut(f64) -> f64) {
    let mut inner = [low + GOLDEN_SECTION * (high - low), high - GOLDEN_SECTION * (high - low)];
    let mut values = inner.map(&mut value_at);
    for _ in 0..NARROWINGS {
        if values[0] < values[1] {
            high = inner[1];
            inner = [low + GOLDEN_SECTION * (high - low), inner[0]];
            values = [value_at(inner[0]), values[0]];
        } else {
            low = inner[0];
            inner = [inner[1], high - GOLDEN_SECTION * (high - low)];
            values = [values[1], value_at(inner[1])];
        }
    }
}

/// Whether a branch may use less than all of the ranges between two samples of what it uses, beside the least one. That falls nowhere
/// faster than it rises on the steeper side of that sample.
fn may_be_within(used: &[f64; LAST_JOINT_SAMPLES]) -> bool {
    let Some((at, least)) = used.iter().copied().enumerate().min_by(|a, b| a.1.total_cmp(&b.1)) else { return false };
    let beside = [at.checked_sub(1), Some(at + 1)].map(|i| i.and_then(|i| used.get(i)).copied());
    let rise = |it: Option<f64>| it.filter(|it| it.is_finite()).map(|it| it - least);
    let [Some(before), Some(after)] = beside.map(rise) else { return true };
    // There two lines of that slope would meet.
    let [lower, steeper] = [before.min(after), before.max(after)];
    least - (steeper - lower) / 2.0 <= 1.0
}

/// The largest fraction of their ranges that joint positions use, from the middle on.
#[derive(Clone, Copy)]
struct Room {
    used: f64,
    q: JointVector,
}

impl Room {
    fn improve(self, best: &mut Option<Self>) {
        if best.is_none_or(|it| self.used < it.used) {
            *best = Some(self);
        }
    }
}

/// The ranges of the seven joints of an S-R-S arm.
pub fn first_seven(ranges: &Ranges) -> [[f64; 2]; 7] {
    std::array::from_fn(|i| ranges[i])
}

fn posture_at(srs: &SrsArm, circle: &ElbowCircle, elbow: Elbow) -> Posture {
    Posture { q: srs.solve_branch(circle, elbow.swivel, elbow.branch), elbow: Some(elbow) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Of two lines with the same slope, that nothing lies between the samples where they use less is known exactly.
        #[test]
        fn what_lies_between_samples_is_told_by_them(slope in 0.01f64..2.0, tip in 1.0f64..2.0, least in 0.5f64..1.5) {
            let used = std::array::from_fn(|sample| least + slope * (sample as f64 - tip).abs());
            prop_assert_eq!(may_be_within(&used), least <= 1.0 + 1e-12);
        }

        /// A search narrows to the lowest place as far as its steps allow.
        #[test]
        fn a_golden_section_search_comes_near_the_lowest_place(lowest in 0.0f64..1.0) {
            let mut nearest = f64::INFINITY;
            golden_section_search([0.0, 1.0], |x| {
                nearest = nearest.min((x - lowest).abs());
                (x - lowest).powi(2)
            });
            prop_assert!(nearest <= GOLDEN_SECTION * (1.0 - GOLDEN_SECTION) + 1e-5);
        }
    }
}
