//! Nodes of a search that are still open.

use std::{cmp::Ordering, collections::BinaryHeap};

use super::{Posture, TerminalVelocity};

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
pub struct Frontier {
    /// Penalty that a failure of a grasp adds to the cost of all of its catches.
    failure_penalty: f64,
    nodes: Vec<Node>,
    heap: BinaryHeap<HeapEntry>,
}

/// Entry of the heap: the cost of a node with its penalties, less being better, and the node's number.
struct HeapEntry {
    order: f64,
    node: usize,
}

impl Frontier {
    /// Creates a frontier without nodes.
    pub fn new(failure_penalty: f64) -> Self {
        Self { failure_penalty, nodes: Vec::new(), heap: BinaryHeap::new() }
    }

    /// Adds a node.
    pub fn push(&mut self, node: Node) {
        let order = node.cost + self.failure_penalty * node.failures as f64;
        self.heap.push(HeapEntry { order, node: self.nodes.len() });
        self.nodes.push(node);
    }

    /// The node that promises most.
    pub fn pop(&mut self) -> Option<Node> {
        self.heap.pop().map(|entry| self.nodes[entry.node])
    }
}

impl Ord for HeapEntry {
    /// The cheapest is the greatest, and among equals the one that came first, so that the order is always
    /// the same.
    fn cmp(&self, other: &Self) -> Ordering {
        other.order.total_cmp(&self.order).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for HeapEntry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for HeapEntry {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for HeapEntry {}
