//! What a search has not looked at closely yet.

use std::{cmp::Ordering, collections::BinaryHeap};

use super::{Arrival, Posture};

/// A catch on its way to being a plan.
#[derive(Clone, Copy)]
pub struct Node {
    /// Which pair of catch time and grasp.
    pub pair: usize,
    /// How closely it has been looked at.
    pub stage: Stage,
}

/// What is known of it, closer and closer.
#[derive(Clone, Copy)]
pub enum Stage {
    Pose,
    Posture(Posture),
    Arrival(Posture, Arrival),
}

impl Stage {
    /// What it takes to look at it closely.
    pub fn work(&self) -> usize {
        match self {
            Self::Pose => 1,
            Self::Posture(_) => 3,
            Self::Arrival(..) => 10,
        }
    }
}

/// Nodes, the one that can become cheapest on top.
#[derive(Default)]
pub struct Frontier {
    nodes: Vec<Node>,
    heap: BinaryHeap<Ticket>,
}

/// The least that a node can cost, and which node.
struct Ticket {
    cost: f64,
    node: usize,
}

impl Frontier {
    /// Adds a node that costs at least this.
    pub fn push(&mut self, cost: f64, node: Node) {
        self.heap.push(Ticket { cost, node: self.nodes.len() });
        self.nodes.push(node);
    }

    /// The node that can become cheapest, and what it costs at least.
    pub fn pop(&mut self) -> Option<(f64, Node)> {
        self.heap.pop().map(|ticket| (ticket.cost, self.nodes[ticket.node]))
    }
}

impl Ord for Ticket {
    /// The cheapest is the greatest, and among equals the one that came first, so that the order is always the same.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for Ticket {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Ticket {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Ticket {}
