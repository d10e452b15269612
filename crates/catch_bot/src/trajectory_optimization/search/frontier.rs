//! Nodes of a search that are still open.

use std::{cmp::Reverse, collections::BinaryHeap};

use super::{Posture, TerminalVelocity, settings::FAILURE_PENALTY};

/// A catch on its way to being a plan.
#[derive(Clone, Copy)]
pub struct Node {
    /// Number of the candidate: a pair of catch time and grasp.
    pub candidate: usize,
    /// Stage up to which the candidate has been evaluated.
    pub stage: Stage,
    /// The least that it can cost.
    pub cost: f64,
    /// Failures of its grasp at any time; each adds the penalty to its cost.
    pub failures: usize,
}

/// Result of each stage of a node's evaluation.
#[derive(Clone, Copy)]
pub enum Stage {
    Pose,
    Posture(Posture),
    TerminalVelocity(Posture, TerminalVelocity),
}

/// Nodes, the one that promises most on top.
#[derive(Default)]
pub struct Frontier {
    nodes: Vec<Node>,
    /// Costs of nodes with their penalties, by their keys, and the nodes' numbers: of those that cost the
    /// same the first comes first, so that the order is always the same.
    heap: BinaryHeap<Reverse<(i64, usize)>>,
}

impl Frontier {
    /// Adds a node.
    pub fn push(&mut self, node: Node) {
        let cost = node.cost + FAILURE_PENALTY * node.failures as f64;
        self.heap.push(Reverse((key(cost), self.nodes.len())));
        self.nodes.push(node);
    }

    /// The node that promises most.
    pub fn pop(&mut self) -> Option<Node> {
        self.heap.pop().map(|Reverse((_, number))| self.nodes[number])
    }
}

/// A whole number for each cost, in the order of [`f64::total_cmp`]: the bits, all but the sign's turned
/// over where it is negative.
fn key(cost: f64) -> i64 {
    let bits = cost.to_bits().cast_signed();
    bits ^ ((bits >> 63) & i64::MAX)
}
