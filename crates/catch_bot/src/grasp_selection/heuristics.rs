//! The paper's three heuristics (III-C): "strength", "catchability" and "comfort".
//!
//! "Catchability" differs from the paper's |v·z_G|, which only knows objects that pass through the gap. What
//! matters is that the object does not move toward a finger: its velocity must lie in the plane of approach
//! (y) and gap (z). In that plane it may pass through the gap or fly toward the palm, but not come from
//! behind.

use catch_body::{Pose, quantity};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::Grasp;

/// Weights of the heuristics. All terms are costs between 0 and about 1.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Weights {
    /// Weight of the fraction of the velocity that points at a finger, |v̂·x_G|.
    pub catchability: quantity::weight,
    /// Weight of the distance of the centre of mass from the gripper's axis, per 30 mm.
    pub strength: quantity::weight,
    /// Weight of the distance by which the centre of mass is farther from the palm than the grasp centre, per
    /// 30 mm.
    pub overhang: quantity::weight,
    /// Weight of the object's width between the fingers, per 100 mm: narrow parts are usually its long sides,
    /// which hold it better.
    pub width: quantity::weight,
    /// Weight of passing through the gap instead of flying toward the palm, which gives four times the time
    /// to close.
    pub pass_through: quantity::weight,
    /// The fraction of the velocity that may point at a finger; grasps with more are dropped.
    pub max_sideways: quantity::cosine,
    /// The fraction of the velocity that may come from behind the palm.
    pub max_from_behind: quantity::cosine,
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            catchability: 13.0,
            strength: 5.0,
            overhang: 6.0,
            width: 22.0,
            pass_through: 6.0,
            max_sideways: 0.3,
            max_from_behind: 0.3,
        }
    }
}

/// Weight on 1 − comfort.
const COMFORT: f64 = 0.2;

impl Weights {
    /// The cost of how an object comes in, by the parts of the direction of its velocity relative to the
    /// gripper that point at a finger and away from the palm.
    pub fn of_direction(&self, sideways: f64, along: f64) -> f64 {
        self.catchability * sideways + self.pass_through * (1.0 + along)
    }
}

/// Direction from which the object enters the gripper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Approach {
    /// The object flies toward the palm.
    TowardPalm,
    /// The object passes between the fingers, across the gap.
    ThroughGap,
}

/// A grasp with its place in the world and its cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RankedGrasp {
    /// Index into the set's grasps.
    pub index: usize,
    /// Pose of the gripper in W when the fingers close.
    pub X_WG: Pose,
    /// Direction from which the object enters.
    pub approach: Approach,
    /// Weighted sum of the heuristics for a gripper that stands still; less is better.
    pub cost: f64,
    /// Part of the cost that does not depend on the velocity.
    pub still_cost: f64,
}

/// An object that passes: its pose, along which direction in O it flies, where the arm stands, and what
/// counts.
#[derive(Debug, Clone, Copy)]
pub struct Passing<'a> {
    X_WO: &'a Pose,
    v_O: Vector3<f64>,
    base: &'a Point3<f64>,
    weights: &'a Weights,
}

impl<'a> Passing<'a> {
    /// Creates the passage of an object at `X_WO`, with the velocity `v_WO` in W; `base` is the position of
    /// the arm.
    pub fn new(X_WO: &'a Pose, v_WO: &Vector3<f64>, base: &'a Point3<f64>, weights: &'a Weights) -> Self {
        let v_O = X_WO.rotation.inverse_transform_vector(v_WO).try_normalize(1e-6).unwrap_or_default();
        Self { X_WO, v_O, base, weights }
    }

    /// Returns whether the object moves at all.
    pub fn moves(&self) -> bool {
        self.v_O != Vector3::zeros()
    }

    /// Returns whether a grasp with these closing and approaching directions in O can catch the object: it
    /// must neither move toward a finger nor come from behind.
    pub fn can_be_caught(&self, [closing_O, approach_O]: &[Vector3<f64>; 2]) -> bool {
        closing_O.dot(&self.v_O).abs() <= self.weights.max_sideways
            && approach_O.dot(&self.v_O) <= self.weights.max_from_behind
    }

    /// Places a grasp with these closing and approaching directions in O on the object, and sums its
    /// heuristics.
    pub fn rank(&self, index: usize, grasp: &Grasp, [closing_O, approach_O]: &[Vector3<f64>; 2]) -> RankedGrasp {
        let Self { X_WO, v_O, base, weights } = self;
        let X_WG = *X_WO * grasp.X_OG;
        let (sideways, along) = (closing_O.dot(v_O).abs(), approach_O.dot(v_O));
        let through_gap = (1.0 - sideways * sideways - along * along).max(0.0).sqrt();
        let approach = if -along >= through_gap { Approach::TowardPalm } else { Approach::ThroughGap };
        // "Comfort": the gripper points away from the axis of the base (paper, III-C), here as a cosine.
        let outward = X_WG.translation.vector - base.coords;
        let comfort = Vector3::new(outward.x, outward.y, 0.0)
            .try_normalize(1e-6)
            .map_or(0.0, |outward| (X_WO.rotation * approach_O).dot(&outward));
        let still_cost = weights.strength * grasp.strength_m / 0.03
            + weights.overhang * grasp.overhang_m / 0.03
            + weights.width * grasp.object_width_m / 0.1
            + COMFORT * (1.0 - comfort);
        RankedGrasp { index, X_WG, approach, cost: still_cost + weights.of_direction(sideways, along), still_cost }
    }

    /// Ranks a single grasp.
    pub fn rank_alone(&self, index: usize, grasp: &Grasp) -> RankedGrasp {
        self.rank(index, grasp, &[grasp.X_OG * Vector3::x(), grasp.X_OG * Vector3::y()])
    }
}
