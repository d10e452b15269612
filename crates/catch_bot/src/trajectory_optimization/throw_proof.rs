//! Proofs that a whole throw is out of reach: at every time, in every attitude of the gripper, over all redundancy.
//!
//! Branch and bound over times and joint positions. A *piece* is an interval of times and one of positions for each joint. It
//! holds no catch if one of three things that every catch has cannot be had anywhere in it:
//!
//! * *place*: p_G(q) = p_O(t). With the Jacobian J at the piece's middle, Δ its half widths, and rᵢⱼ the distance of the grasp
//!   centre from the later of two joints, which bounds ∂²p_G/∂qᵢ∂qⱼ,
//!
//!   ```text
//!   p_G(q) = p_G + J·δq + e,   |e| ≤ ½ Σᵢⱼ rᵢⱼ·Δᵢ·Δⱼ
//!   ```
//!   Each row of this also narrows each joint to what the others can make up for.
//! * *velocity*: J_v·q̇ = s·v_O with 0 ≤ s ≤ s_max and the velocities that each joint can have on arrival ([`super::reachability`]). A
//!   direction λ separates the two sides if max λᵀ·J_v·q̇ < min λᵀ·s·v_O over the piece, where |ΔJᵢ| ≤ Σₖ rᵢₖ·Δₖ.
//! * *direction*: the gripper does not come from behind, y_G·v_O ≤ c·|v_O|.
//!
//! What is left is halved. Torque, collision and the object's shape bar more, and are not needed.

use catch_body::{JointVector, MAX_JOINTS, robot::Jacobian};
use nalgebra::{Point3, Vector3};

use super::{
    Planner, Start,
    arrival::shortfall,
    motion::Shares,
    reachability::{Interval, JointReach},
};
use crate::trajectory_prediction::FlightTrajectory;

/// How long the first pieces are, in seconds.
const FIRST_PIECE_S: f64 = 0.01;

/// What a proof came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ThrowProof {
    /// No catch exists; so many pieces were looked at.
    OutOfReach {
        /// Pieces.
        pieces: usize,
    },
    /// There is no proof; this piece was the first that could not be halved any more.
    Open {
        /// Its middle time.
        catch_s: f64,
        /// Its middle joint positions.
        q: JointVector,
    },
}

/// A box of times and joint positions.
#[derive(Debug, Clone, Copy)]
struct Piece {
    time_s: Interval,
    q: [Interval; MAX_JOINTS],
}

impl Interval {
    fn middle(&self) -> f64 {
        f64::midpoint(self.low, self.high)
    }

    fn half_width(&self) -> f64 {
        (self.high - self.low) / 2.0
    }
}

impl Planner {
    /// Proves that an arm that starts from rest cannot catch what flies along `flight` until `until_s`, if so.
    pub fn prove_out_of_reach(
        &self,
        start: &Start,
        flight: &FlightTrajectory,
        until_s: f64,
        most_from_behind: f64,
        most_pieces: usize,
    ) -> ThrowProof {
        let proof = Proof { planner: self, start, flight, most_from_behind };
        let (mut pieces, mut time_s) = (0, start.time_s);
        while time_s < until_s {
            let next_s = (time_s + FIRST_PIECE_S).min(until_s);
            let first = Piece { time_s: Interval { low: time_s, high: next_s }, q: [Interval { low: -1e3, high: 1e3 }; MAX_JOINTS] };
            let before = pieces;
            let mut left = vec![first];
            while let Some(piece) = left.pop() {
                pieces += 1;
                let Some((piece, widest)) = proof.narrowed(piece) else { continue };
                if pieces > most_pieces {
                    return ThrowProof::Open { catch_s: piece.time_s.middle(), q: JointVector::from_fn(|i, _| piece.q[i].middle()) };
                }
                left.extend(piece.halves(widest));
            }
            if pieces > before + 10 { println!("{time_s:.3}: {}", pieces - before); }
            time_s = next_s;
        }
        ThrowProof::OutOfReach { pieces }
    }
}

impl Piece {
    fn halves(&self, at: usize) -> [Self; 2] {
        let (mut low, mut high) = (*self, *self);
        if at == MAX_JOINTS {
            let middle = self.time_s.middle();
            (low.time_s.high, high.time_s.low) = (middle, middle);
        } else {
            let middle = self.q[at].middle();
            (low.q[at].high, high.q[at].low) = (middle, middle);
        }
        [low, high]
    }
}

struct Proof<'a> {
    planner: &'a Planner,
    start: &'a Start,
    flight: &'a FlightTrajectory,
    most_from_behind: f64,
}

impl Proof<'_> {
    fn narrowed(&self, mut piece: Piece) -> Option<(Piece, usize)> {
        let robot = &self.planner.robot;
        let dof = robot.dof();
        let s_max = self.planner.config.max_speed_fraction;
        // Who can be somewhere at some time can, from rest, also be there later.
        let reaches = self.planner.reaches(self.start, piece.time_s.high - self.start.time_s, Shares { velocity: 1.0, acceleration: 1.0 });
        for (i, joint) in robot.joints.iter().enumerate() {
            let far = reaches[i].displacements();
            let from = self.start.state.q[i];
            let able = Interval { low: joint.limits.lower.max(from + far.low), high: joint.limits.upper.min(from + far.high) };
            piece.q[i] = piece.q[i].intersection(&able);
            if piece.q[i].is_empty() {
                return None;
            }
        }
        for i in dof..MAX_JOINTS {
            piece.q[i] = Interval { low: 0.0, high: 0.0 };
        }
        let (catch_s, half_s) = (piece.time_s.middle(), piece.time_s.half_width());
        let q = JointVector::from_fn(|i, _| piece.q[i].middle());
        let half = JointVector::from_fn(|i, _| piece.q[i].half_width());
        let X_WL = robot.link_poses(&q);
        let X_WG = robot.gripper_in(&X_WL);
        let p_G: Point3<f64> = X_WG * self.planner.gripper.grasp_centre();
        let J: Jacobian = robot.jacobian(&X_WL, &p_G);
        // Distances of the grasp centre from the joints, anywhere in the piece: only the joints beyond change them.
        let mut distance = [0.0; MAX_JOINTS];
        let mut moved = 0.0;
        for i in (0..dof).rev() {
            let (axis, origin) = robot.joint_axis(&X_WL, i);
            // Of the lever, only what is perpendicular to the axis counts.
            let _ = axis;
            distance[i] = ((p_G - origin).norm() + moved).min(self.planner.extents_m[i]);
            moved += half[i] * distance[i];
        }
        let (X_WO, v_O) = (self.flight.pose_at(catch_s), self.flight.twist_at(catch_s).linear);
        let p_O = X_WO.translation.vector;
        let g = 9.81;
        let mut error = 0.5 * g * half_s * half_s;
        for i in 0..dof {
            for j in 0..dof {
                error += 0.5 * half[i] * half[j] * distance[i.max(j)];
            }
        }
        // Direction.
        let approach = X_WG * Vector3::y();
        let turned: f64 = (0..dof).map(|i| half[i]).sum();
        let speed = v_O.norm();
        if approach.dot(&v_O) - turned * speed - g * half_s > self.most_from_behind * (speed + g * half_s) {
            return None;
        }
        // Place.
        let gap = p_G.coords - p_O;
        let mut delta: [Interval; MAX_JOINTS + 1] = [Interval { low: 0.0, high: 0.0 }; MAX_JOINTS + 1];
        for i in 0..dof {
            delta[i] = Interval { low: -half[i], high: half[i] };
        }
        delta[MAX_JOINTS] = Interval { low: -half_s, high: half_s };
        let linear = J.fixed_rows::<3>(3);
        let mut rows = vec![Vector3::x(), Vector3::y(), Vector3::z()];
        if let Some(u) = gap.try_normalize(1e-9) {
            rows.push(u);
        }
        for _ in 0..2 {
            for u in &rows {
                let mut coefficient = [0.0; MAX_JOINTS + 1];
                for i in 0..dof {
                    coefficient[i] = u.dot(&linear.column(i));
                }
                coefficient[MAX_JOINTS] = -u.dot(&v_O);
                let mut sum = Interval { low: u.dot(&gap) - error, high: u.dot(&gap) + error };
                let term = |c: f64, d: &Interval| Interval { low: (c * d.low).min(c * d.high), high: (c * d.low).max(c * d.high) };
                for (c, d) in coefficient.iter().zip(&delta) {
                    let t = term(*c, d);
                    sum.low += t.low;
                    sum.high += t.high;
                }
                if sum.low > 0.0 || sum.high < 0.0 {
                    return None;
                }
                for (c, d) in coefficient.iter().zip(&mut delta) {
                    if c.abs() < 1e-6 {
                        continue;
                    }
                    let t = term(*c, d);
                    // c·d = −(the rest)
                    let rest = Interval { low: sum.low - t.low, high: sum.high - t.high };
                    let (a, b) = (-rest.low / c, -rest.high / c);
                    let new = d.intersection(&Interval { low: a.min(b) - 1e-12, high: a.max(b) + 1e-12 });
                    if new.is_empty() {
                        return None;
                    }
                    let n = term(*c, &new);
                    sum.low += n.low - t.low;
                    sum.high += n.high - t.high;
                    *d = new;
                }
            }
        }
        for i in 0..dof {
            piece.q[i] = Interval { low: q[i] + delta[i].low, high: q[i] + delta[i].high };
        }
        piece.time_s = Interval { low: catch_s + delta[MAX_JOINTS].low, high: catch_s + delta[MAX_JOINTS].high };
        // Velocity.
        let mut bounds = [Interval { low: 0.0, high: 0.0 }; MAX_JOINTS];
        for i in 0..dof {
            let from = self.start.state.q[i];
            let reach: &JointReach = &reaches[i];
            let far = reach.displacements();
            let at = |q: f64| reach.arrival_velocities((q - from).clamp(far.low, far.high));
            bounds[i] = Interval { low: at(piece.q[i].low).low - 1e-9, high: at(piece.q[i].high).high + 1e-9 };
        }
        if let Some(lambda) = shortfall(&J, &v_O, &bounds, s_max) {
            let mut reached = 0.0;
            for i in 0..dof {
                let along = lambda.dot(&linear.column(i));
                let varied: f64 = (0..dof).map(|k| half[k] * distance[i.max(k)]).sum();
                let Interval { low, high } = bounds[i];
                reached += (along * low).max(along * high) + varied * lambda.norm() * low.abs().max(high.abs());
            }
            let least = s_max * (lambda.dot(&v_O) - g * half_s * lambda.norm());
            if reached < least.min(0.0) {
                return None;
            }
        }
        // What matters most is halved.
        let weight = |i: usize| if i == MAX_JOINTS { piece.time_s.half_width() * 4.0 } else { piece.q[i].half_width() * distance[i] };
        let widest = (0..=MAX_JOINTS).max_by(|&a, &b| weight(a).total_cmp(&weight(b)))?;
        Some((piece, widest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
}
