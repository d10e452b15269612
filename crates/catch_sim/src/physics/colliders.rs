//! Colliders: the pairs that can touch, and their contact points.

use catch_body::{
    Gripper, Pose, Robot, Twist,
    shape::{Capsule, Cuboid},
    workcell::{FLOOR_Z_M, Obstacle},
};
use nalgebra::Vector3;
use parry3d_f64::{
    math,
    query::{self, ContactManifold, DefaultQueryDispatcher, PersistentQueryDispatcher, TrackedContact},
    shape::SharedShape,
};

use super::{
    Part,
    machine::{COORDINATES, Machine},
    spatial::Spatial,
};
use crate::{
    convert::{from_vector, to_pose, to_vector, to_vectors},
    object::ThrownObject,
    object_shape::ColliderPart,
};

/// Things that come closer than this in a step are looked at in detail, in metres, besides what they move.
const MARGIN_M: f64 = 1e-3;
/// Points of a pair that are closer than this are one, in metres.
const SAME_POINT_M: f64 = 1e-4;
/// Points for which there is room, of each pair and of all: with more, a step allocates.
const POINTS_OF_PAIR: usize = 8;
const POINTS: usize = 64;

/// Body to which a collider is fixed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Body {
    /// The world, or the base of the arm.
    Fixed,
    /// A body of the machine.
    Link(usize),
    Object,
}

#[derive(Clone)]
struct Collider {
    body: Body,
    part: Part,
    shape: SharedShape,
    /// Pose of the shape in the body.
    X_BS: Pose,
    /// Radius of the sphere that encloses it, about the centre of the shape in its own frame.
    centre: math::Vector,
    radius_m: f64,
    at: Place,
}

/// Place of a collider when a step begins, in W.
#[derive(Clone, Default)]
struct Place {
    X_WS: math::Pose,
    centre: math::Vector,
    /// The most that one of its points moves per second.
    speed_mps: f64,
}

impl Collider {
    fn pose(&self, bodies: &Bodies) -> math::Pose {
        to_pose(&(bodies.pose(self.body) * self.X_BS))
    }

    fn place(&self, bodies: &Bodies) -> Place {
        let X_WS = self.pose(bodies);
        let centre = X_WS * self.centre;
        Place { X_WS, centre, speed_mps: bodies.speed_mps(self.body, &from_vector(centre), self.radius_m) }
    }
}

/// Forces at the end of the step before, from which the solver starts.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Load {
    pub normal_n: f64,
    pub friction_n: math::Vector,
}

/// Two colliders that may touch. The pushing one is part of the machine or fixed; the pushed one is the
/// object or part of the machine.
struct Pair {
    pushing: usize,
    pushed: usize,
    manifold: ContactManifold<(), Load>,
}

/// A point at which two bodies touch, or may in the step to come.
#[derive(Debug, Clone)]
pub(super) struct Touch {
    /// Part that pushes.
    pub part: Part,
    pub pushing: Body,
    pub pushed: Body,
    /// Normal from the pushing body to the pushed one, in W.
    pub normal: Vector3<f64>,
    pub point: Vector3<f64>,
    /// Distance of the surfaces, below zero where they overlap.
    pub gap_m: f64,
    /// Load of the step before.
    pub load: Load,
    /// The pair and the number of the point in its manifold.
    point_of_pair: [usize; 2],
}

impl Touch {
    /// Two directions across the normal, across each other.
    pub fn across(&self) -> [Vector3<f64>; 2] {
        let one = self.normal.cross(&Vector3::ith(self.normal.iamin(), 1.0)).normalize();
        [one, self.normal.cross(&one)]
    }
}

/// Poses and velocities of the bodies.
pub(super) struct Bodies {
    pub X_WL: [Pose; COORDINATES + 1],
    pub motions: [Spatial; COORDINATES + 1],
    pub X_WO: Pose,
    pub V_WO: Twist,
}

impl Bodies {
    fn pose(&self, body: Body) -> Pose {
        match body {
            Body::Fixed => Pose::identity(),
            Body::Link(link) => self.X_WL[link],
            Body::Object => self.X_WO,
        }
    }

    /// Angular velocity of a body, and velocity of its point that is at `point`.
    fn velocities(&self, body: Body, point: &Vector3<f64>) -> [Vector3<f64>; 2] {
        match body {
            Body::Fixed => [Vector3::zeros(); 2],
            Body::Link(link) => [self.motions[link].angular, self.motions[link].velocity_at(point)],
            Body::Object => [self.V_WO.angular, self.V_WO.velocity_at(&(point - self.X_WO.translation.vector))],
        }
    }

    /// The most that a point within `radius_m` of a centre can move per second.
    fn speed_mps(&self, body: Body, centre: &Vector3<f64>, radius_m: f64) -> f64 {
        let [angular, linear] = self.velocities(body, centre);
        if body == Body::Fixed { 0.0 } else { linear.norm() + angular.norm() * radius_m }
    }

    /// Relative speed of two bodies at a contact, in m/s.
    pub fn relative_mps(&self, touch: &Touch) -> f64 {
        let velocity = |body: Body| self.velocities(body, &touch.point)[1];
        (velocity(touch.pushed) - velocity(touch.pushing)).norm()
    }
}

/// Everything that can touch something.
pub(super) struct Colliders {
    colliders: Vec<Collider>,
    pairs: Vec<Pair>,
    /// Points at which something may touch something in the step to come.
    pub touches: Vec<Touch>,
}

impl Colliders {
    /// Colliders of the floor, the arm with the obstacles around it, and the gripper. The object is still
    /// missing.
    pub fn new(machine: &Machine, robot: &Robot, gripper: &Gripper) -> Self {
        let touches = Vec::with_capacity(POINTS);
        let mut new = Self { colliders: Vec::new(), pairs: Vec::new(), touches };
        let up = SharedShape::halfspace(math::Vector::Z);
        new.add(Body::Fixed, Part::Floor, up, Pose::translation(0.0, 0.0, FLOOR_Z_M));
        let base = |link: usize| if link == 0 { Body::Fixed } else { Body::Link(link) };
        let in_base = |link: usize| if link == 0 { machine.X_WB } else { Pose::identity() };
        robot.obstacles.iter().for_each(|obstacle| new.add_obstacle(obstacle));
        for (link, capsule) in &robot.capsules {
            new.add(base(*link), Part::Arm, of_capsule(capsule), in_base(*link));
        }
        let X_BG = in_base(machine.hand) * machine.X_HG;
        new.add_box(base(machine.hand), Part::Palm, &gripper.body(), &X_BG);
        let parts = [Part::LeftFinger, Part::RightFinger];
        for (i, (part, (finger, balls))) in parts.into_iter().zip(gripper.finger_contacts(0.0)).enumerate() {
            let body = Body::Link(machine.hand + 1 + i);
            new.add_box(body, part, &finger, &Pose::identity());
            for (centre, radius_m) in balls {
                new.add(body, part, SharedShape::ball(radius_m), Pose::from_parts(centre.into(), Default::default()));
            }
        }
        let (fixed, moving): (Vec<usize>, Vec<usize>) =
            (0..new.colliders.len()).partition(|&i| new.colliders[i].body == Body::Fixed);
        let stands = |it: &&usize| matches!(new.colliders[**it].part, Part::Floor | Part::Obstacle);
        new.pairs = fixed.iter().filter(stands).flat_map(|&i| moving.iter().map(move |&j| Pair::new(i, j))).collect();
        new
    }

    /// Takes the object out that there was, and puts another one in.
    pub fn exchange_object(&mut self, object: &ThrownObject) {
        let is_object = |collider: &Collider| collider.body == Body::Object;
        self.colliders.retain(|it| !is_object(it));
        self.pairs.retain(|it| it.pushed < self.colliders.len());
        let others = self.colliders.len();
        for part in &object.parts {
            let (shape, X_OS) = match part {
                ColliderPart::Ball { centre, radius_m } => {
                    (SharedShape::ball(*radius_m), Pose::translation(centre.x, centre.y, centre.z))
                }
                ColliderPart::Hull(points) => {
                    let hull =
                        SharedShape::convex_hull(&to_vectors(points)).expect("a part of an object encloses a volume");
                    (hull, Pose::identity())
                }
            };
            self.add(Body::Object, Part::Object, shape, X_OS);
        }
        for pushing in 0..others {
            self.pairs.extend((others..self.colliders.len()).map(|pushed| Pair::new(pushing, pushed)));
        }
    }

    fn add(&mut self, body: Body, part: Part, shape: SharedShape, X_BS: Pose) {
        let sphere = shape.compute_local_bounding_sphere();
        let (centre, radius_m) = (sphere.center, sphere.radius);
        self.colliders.push(Collider { body, part, shape, X_BS, centre, radius_m, at: Place::default() });
    }

    fn add_box(&mut self, body: Body, part: Part, cuboid: &Cuboid, X_BC: &Pose) {
        let half = cuboid.size / 2.0;
        let X_BS = X_BC * nalgebra::Translation3::from(cuboid.centre.coords);
        self.add(body, part, SharedShape::cuboid(half.x, half.y, half.z), X_BS);
    }

    fn add_obstacle(&mut self, obstacle: &Obstacle) {
        if let Some((X_WS, cuboid)) = obstacle.as_cuboid() {
            self.add_box(Body::Fixed, Part::Obstacle, cuboid, X_WS);
        }
        if let Some(capsule) = obstacle.as_capsule() {
            self.add(Body::Fixed, Part::Obstacle, of_capsule(capsule), Pose::identity());
        }
    }

    /// Finds all points at which something may touch something within `step_s`.
    ///
    /// Pairs are sorted out by the sphere around what is pushed; the others are looked at by the library.
    pub fn find_touches(&mut self, bodies: &Bodies, step_s: f64) {
        let Self { colliders, pairs, touches } = self;
        colliders.iter_mut().for_each(|it| it.at = it.place(bodies));
        touches.clear();
        for (number, pair) in pairs.iter_mut().enumerate() {
            let [one, other] = [&colliders[pair.pushing], &colliders[pair.pushed]];
            let reach_m = MARGIN_M + (one.at.speed_mps + other.at.speed_mps) * step_s;
            let Pair { manifold, .. } = pair;
            if one.shape.distance_to_point(&one.at.X_WS, other.at.centre, true) > other.radius_m + reach_m {
                manifold.points.clear();
                continue;
            }
            let X_12 = one.at.X_WS.inv_mul(&other.at.X_WS);
            DefaultQueryDispatcher
                .contact_manifold_convex_convex(&X_12, &*one.shape, &*other.shape, None, None, reach_m, manifold)
                .expect("all shapes here are convex");
            for (i, point) in manifold.points.iter().enumerate() {
                let is_same = |it: &TrackedContact<Load>| it.local_p1.distance(point.local_p1) < SAME_POINT_M;
                if point.dist > reach_m || manifold.points[..i].iter().any(is_same) {
                    continue;
                }
                touches.push(Touch {
                    part: one.part,
                    pushing: one.body,
                    pushed: other.body,
                    normal: from_vector(one.at.X_WS.rotation * manifold.local_n1),
                    point: from_vector((one.at.X_WS * point.local_p1 + other.at.X_WS * point.local_p2) / 2.0),
                    gap_m: point.dist,
                    load: point.data,
                    point_of_pair: [number, i],
                });
            }
        }
    }

    /// Keeps what a point bore in the step that has passed.
    pub fn keep_load(&mut self, touch: &Touch, load: Load) {
        let [pair, point] = touch.point_of_pair;
        self.pairs[pair].manifold.points[point].data = load;
    }

    /// Part that is nearest to the object, and its distance in metres: zero where they touch or overlap.
    pub fn nearest_to_object(&self, bodies: &Bodies) -> Option<(&'static str, f64)> {
        let with_object = self.pairs.iter().filter(|it| self.colliders[it.pushed].body == Body::Object);
        let gaps = with_object.map(|pair| {
            let [one, other] = [&self.colliders[pair.pushing], &self.colliders[pair.pushed]];
            let gap = query::distance(&one.pose(bodies), &*one.shape, &other.pose(bodies), &*other.shape);
            (one.part.name(), gap.map_or(f64::INFINITY, |it| it.distance))
        });
        gaps.min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

impl Pair {
    fn new(pushing: usize, pushed: usize) -> Self {
        let mut manifold = ContactManifold::new();
        manifold.points.reserve(POINTS_OF_PAIR);
        Self { pushing, pushed, manifold }
    }
}

fn of_capsule(capsule: &Capsule) -> SharedShape {
    let Capsule { from, to, radius } = capsule;
    SharedShape::capsule(to_vector(&from.coords), to_vector(&to.coords), *radius)
}
