//! How far a released object is from everything that it could touch.

use rapier3d_f64::parry::query;

use super::{Part, World};

impl World {
    /// What is nearest to the object, and its distance in metres: zero where they touch or overlap.
    pub(crate) fn nearest_to_object(&self) -> Option<(&'static str, f64)> {
        let pose_of = |collider: &rapier3d_f64::prelude::Collider| {
            let of_body = collider.parent().and_then(|body| Some(*self.bodies.get(body)?.position()));
            let within = collider.position_wrt_parent().copied();
            of_body.zip(within).map_or(*collider.position(), |(X_WB, X_BC)| X_WB * X_BC)
        };
        let is_object = |collider: &rapier3d_f64::prelude::Collider| collider.parent() == Some(self.object);
        let others = self.colliders.iter().map(|(_, it)| it).filter(|it| !is_object(it));
        let gap = |other: &rapier3d_f64::prelude::Collider| {
            let own = self.colliders.iter().map(|(_, it)| it).filter(|it| is_object(it));
            let gaps = own.map(|it| query::distance(&pose_of(it), it.shape(), &pose_of(other), other.shape()));
            // Every pair of shapes that the builder makes is supported.
            gaps.map(|gap| gap.map_or(f64::INFINITY, |it| it.distance)).fold(f64::INFINITY, f64::min)
        };
        let named = others.map(|it| (Part::of(it.user_data).name(), gap(it)));
        named.min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

impl Part {
    fn of(user_data: u128) -> Self {
        super::PARTS[user_data as usize]
    }

    /// How a person calls it.
    fn name(self) -> &'static str {
        match self {
            Self::Object => "itself",
            Self::LeftFinger | Self::RightFinger => "a finger",
            Self::Palm => "the palm",
            Self::Arm => "the arm",
            Self::Floor => "the floor",
            Self::Obstacle => "an obstacle",
        }
    }
}
