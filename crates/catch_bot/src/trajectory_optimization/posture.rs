//! Postures: the joint positions in which the gripper is at a given pose, over the arm's whole redundancy.
//!
//! S-R-S arms have them in closed form, as arcs of swivel angles on which every joint is within its range;
//! nothing is lost between samples. Arms of six joints with three parallel axes have at most eight, in closed
//! form too, and other arms of seven with a spherical shoulder at most eight for each angle of the last
//! joint, which is sampled. Other arms have them by iteration: from where the arm is and from the middle of
//! what it can reach, or, where that did not do, from more starts and along the null space.

use catch_body::{
    JointVector, Pose, Robot,
    inverse_kinematics::{Branch, ElbowCircle, ParallelAxesArm, Ranges, SphericalShoulderArm, SrsArm},
};

/// Swivel angles that are looked at in each arc, as fractions of it.
const FRACTIONS_OF_ARC: [f64; 5] = [0.5, 0.25, 0.75, 0.05, 0.95];

/// Position of the elbow of an S-R-S arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elbow {
    /// Branch of the eight solutions.
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
    /// Position of the elbow, for S-R-S arms.
    pub elbow: Option<Elbow>,
}

/// The arm's way of finding postures.
#[derive(Debug)]
pub enum PostureFinder {
    /// Inverse kinematics in closed form, over the whole self-motion.
    Srs(SrsArm),
    /// Inverse kinematics in closed form, without self-motion.
    ParallelAxes(ParallelAxesArm),
    /// Inverse kinematics in closed form for each angle of the last joint.
    SphericalShoulder(SphericalShoulderArm),
    /// Inverse kinematics by iteration from several starts.
    Numerical,
}

impl PostureFinder {
    /// Chooses the inverse kinematics of an arm.
    pub fn new(robot: &Robot) -> Self {
        let srs = SrsArm::of(robot).map(Self::Srs);
        let closed = srs.or_else(|| ParallelAxesArm::of(robot).map(Self::ParallelAxes));
        let closed = closed.or_else(|| SphericalShoulderArm::of(robot).map(Self::SphericalShoulder));
        closed.unwrap_or(Self::Numerical)
    }

    /// Cost of finding the postures of a pose, in the units of the search's work.
    pub fn work(&self, thorough: bool) -> usize {
        match (self, thorough) {
            (Self::Srs(_) | Self::ParallelAxes(_), _) => 1,
            (Self::SphericalShoulder(_), false) => 5,
            (Self::SphericalShoulder(_), true) => 20,
            (Self::Numerical, false) => 4,
            (Self::Numerical, true) => 40,
        }
    }

    /// Returns whether the gripper may hold an object at `X_WO` by a grasp at `X_OG` at all, as far as a
    /// quick test shows.
    pub fn may_reach(&self, X_WO: &Pose, ranges: &Ranges) -> impl Fn(&Pose) -> bool + use<> {
        let near = match self {
            Self::Srs(srs) => {
                let shoulder_O = X_WO.inverse_transform_point(&srs.shoulder);
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

    /// Postures within `ranges`, from all over the redundancy; where they take iterations only if the search
    /// is `thorough`, else the ones that few starts find.
    pub fn postures(
        &self,
        robot: &Robot,
        X_WG: &Pose,
        from: &JointVector,
        ranges: &Ranges,
        thorough: bool,
    ) -> Vec<Posture> {
        let alone = |found: Vec<JointVector>| found.into_iter().map(|q| Posture { q, elbow: None }).collect();
        let srs = match self {
            Self::Srs(srs) => srs,
            Self::ParallelAxes(arm) => return alone(arm.solutions(X_WG, from, ranges)),
            Self::SphericalShoulder(arm) => return alone(arm.solutions(X_WG, from, ranges, thorough)),
            Self::Numerical if thorough => return alone(robot.solutions_within(X_WG, from, ranges)),
            Self::Numerical => return alone(robot.first_solutions_within(X_WG, from, ranges)),
        };
        let Some(circle) = srs.elbow_circle(X_WG) else { return Vec::new() };
        let arcs = srs.swivels(&circle, ranges);
        let mut found = Vec::with_capacity(arcs.len() * FRACTIONS_OF_ARC.len());
        for (branch, arc) in arcs {
            found.extend(FRACTIONS_OF_ARC.map(|fraction| {
                posture_at(srs, &circle, Elbow { branch, arc, swivel: arc[0] + fraction * (arc[1] - arc[0]) })
            }));
        }
        found
    }

    /// `known` for a pose that has changed a little: the elbow, or what the null space moves, moved by `by`
    /// radians; `None` where nothing is free to move.
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
                let along = if by == 0.0 { JointVector::zeros() } else { robot.self_motion(&known.q)? };
                let q = robot.nearby_solution(X_WG, &(known.q + along * by), &robot.joint_ranges())?;
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

fn posture_at(srs: &SrsArm, circle: &ElbowCircle, elbow: Elbow) -> Posture {
    Posture { q: srs.solve_branch(circle, elbow.swivel, elbow.branch), elbow: Some(elbow) }
}
