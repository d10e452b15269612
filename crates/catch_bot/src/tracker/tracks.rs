//! Tracks of all things that could be the object: poses and flight of each.

use std::ops::RangeInclusive;

use catch_body::{Pose, dynamics::gravity, symmetry::Symmetry, workcell::FLOOR_Z_M};

use super::LOST_AFTER_S;
use crate::{
    perception::{GATE_M, ObjectPose, PoseEstimator, ReferenceModel, View},
    preparation::Preparation,
    trajectory_optimization::MotionPlanner,
    trajectory_prediction::{FlightPredictor, FlightTrajectory, PredictionStatus, free_fall::log_evidence},
};

/// Times between two poses that tell a velocity, in seconds.
const PARABOLA_S: RangeInclusive<f64> = 0.005..=0.15;
/// Poses that are remembered, more than any prediction looks back at.
pub(super) const POSES: usize = 1024;
/// Largest speed of a thing beside what is expected of it, in m/s.
const UNEXPECTED_MPS: f64 = 15.0;
/// Time before the newest pose from which on a flight counts as one that leads to the arm, in seconds.
const PAST_S: f64 = 1.0;
/// Number of steps of that check, and the length of one in seconds.
const STEPS: usize = 125;
const STEP_S: f64 = 0.02;

/// Least logarithm of how much likelier free fall is than uniform motion: a thousand times.
const LEAST_EVIDENCE: f64 = 7.0;
/// Largest number of things that are tracked besides the object.
const MOST_OTHERS: usize = 4;
/// Time after which a thing that is not seen any more is forgotten, in seconds.
const FORGOTTEN_AFTER_S: f64 = 2.0 * LOST_AFTER_S;

/// The object, and what else moves.
///
/// A person's hand looks like a ball to one camera for an image or two. Until a flight leads to the arm, all
/// that could be the object is tracked side by side.
#[derive(Debug, Clone)]
pub(crate) struct Tracks {
    /// The object.
    pub object: Track,
    /// Other things that move, as long as any of them could be the object.
    others: Vec<Track>,
    /// True if the object flies, by all images so far.
    pub flies: bool,
    /// True if the object flies to the arm: nothing else is looked for.
    pub(super) is_followed: bool,
    /// Capture time of the newest image without a mask. Masks tell the object from all else.
    pub unlabelled_s: Option<f64>,
}

/// One thing that moves: its poses and, once these agree on one, its flight.
#[derive(Debug, Clone, Default)]
pub(crate) struct Track {
    /// Poses, oldest first.
    pub poses: Vec<ObjectPose>,
    /// Flight as it was predicted last.
    pub flight: Option<FlightTrajectory>,
}

impl Track {
    /// Capture time of the newest pose, in seconds.
    pub fn seen_s(&self) -> f64 {
        self.poses.last().map_or(f64::NEG_INFINITY, |pose| pose.capture_s)
    }

    /// Adds a pose to those so far, oldest first: images may arrive later than others that were taken after
    /// them. Where there are as many as are remembered, the oldest one is forgotten.
    pub fn remember(&mut self, pose: ObjectPose) {
        if self.poses.len() == POSES {
            self.poses.remove(0);
        }
        let at = self.poses.partition_point(|it| it.capture_s <= pose.capture_s);
        self.poses.insert(at, pose);
    }

    /// Expected pose at a time: on the flight; before there is one, on the parabola through an early pose and
    /// the newest, with the orientation of the latter. That keeps an object that looks the same from two
    /// sides from flipping between the first images.
    pub fn expected_pose(&self, time_s: f64) -> Option<Pose> {
        if let Some(flight) = &self.flight {
            return Some(flight.pose_at(time_s));
        }
        let last = self.poses.last()?;
        let mut X_WO = last.X_WO;
        let span_s = |first: &ObjectPose| last.capture_s - first.capture_s;
        if let Some(first) = self.poses.iter().find(|first| PARABOLA_S.contains(&span_s(first))) {
            let ahead_s = time_s - last.capture_s;
            let moved_W = last.X_WO.translation.vector - first.X_WO.translation.vector;
            let v_WO = moved_W / span_s(first) + gravity() * (0.5 * span_s(first));
            X_WO.translation.vector += (v_WO + gravity() * (0.5 * ahead_s)) * ahead_s;
        }
        Some(X_WO)
    }

    /// Distance of a pose from the expected one in metres, if it may be one of this thing, whose size is
    /// given by a radius. It is infinite where nothing is expected yet.
    pub fn distance_m(&self, pose: &ObjectPose, radius_m: f64) -> Option<f64> {
        let Some(X_WO) = self.expected_pose(pose.capture_s) else { return Some(f64::INFINITY) };
        let distance_m = (pose.X_WO.translation.vector - X_WO.translation.vector).norm();
        let unexpected_m = UNEXPECTED_MPS * (pose.capture_s - self.seen_s()).abs().min(LOST_AFTER_S);
        (distance_m < radius_m + GATE_M + unexpected_m).then_some(distance_m)
    }

    /// Returns whether the flight leads, or lately led, to the arm.
    fn leads_or_led_to(&self, arm: &MotionPlanner) -> bool {
        self.flight.as_ref().is_some_and(|flight| self.leads_to(arm, flight.time_s - PAST_S))
    }

    /// Predicts the flight that the poses agree on. The last one stays where there is none.
    pub fn predict(
        &mut self,
        predictor: &mut dyn FlightPredictor,
        symmetry: &Symmetry,
    ) -> Result<(), PredictionStatus> {
        let mut flight = predictor.predict(&self.poses, self.flight.as_ref())?;
        if let Some(previous) = &self.flight {
            flight.R_WO = symmetry.nearest_alike(&previous.pose_at(flight.time_s).rotation, &flight.R_WO);
        }
        self.flight = Some(flight);
        Ok(())
    }

    /// Logarithm of how much likelier the poses are of a thing that falls freely. `None` if they do not tell.
    fn evidence(&self) -> Option<f64> {
        self.flight.as_ref().and_then(|flight| log_evidence(&self.poses, flight))
    }

    /// Returns whether the poses show that it falls freely.
    fn falls(&self) -> bool {
        self.evidence().is_some_and(|evidence| evidence > LEAST_EVIDENCE)
    }

    /// Returns whether the flight leads, from a time on, to where the gripper can be above the floor.
    fn leads_to(&self, arm: &MotionPlanner, from_s: f64) -> bool {
        let (Some(flight), Some(first)) = (&self.flight, self.poses.first()) else { return false };
        let (base, reach_m) = (arm.robot.X_WB.translation.vector.into(), arm.longest_reach_m());
        let (mut flown, from_s) = (flight.propagator(), first.capture_s.max(from_s));
        let path = (0..STEPS).map(|i| flown.position_at(from_s + STEP_S * i as f64));
        let in_air = path.skip_while(|p_W| p_W.z <= FLOOR_Z_M).take_while(|p_W| p_W.z > FLOOR_Z_M);
        in_air.map(|p_W| nalgebra::distance(&p_W, &base)).any(|distance_m| distance_m < reach_m)
    }
}

impl Tracks {
    /// Nothing yet, with room for the object's poses.
    pub fn new() -> Self {
        let object = Track { poses: Vec::with_capacity(POSES), flight: None };
        Self { object, others: Vec::new(), flies: false, is_followed: false, unlabelled_s: None }
    }

    /// The object's flight, if it leads to the arm and the object was seen lately at a time.
    pub fn followed(&self, time_s: f64) -> Option<&FlightTrajectory> {
        let is_lost = |flight: &FlightTrajectory| self.unlabelled_s.is_some() && time_s > flight.time_s + LOST_AFTER_S;
        self.object.flight.as_ref().filter(|flight| self.is_followed && !is_lost(flight))
    }

    /// Returns whether the object falls freely to the arm.
    pub fn falls_to(&self, arm: &MotionPlanner, now_s: f64) -> bool {
        self.object.falls() && self.object.leads_to(arm, now_s)
    }

    /// Returns whether the object no longer falls to the arm: it has passed, or was none that falls.
    pub fn is_over(&self, arm: &MotionPlanner, now_s: f64) -> bool {
        !self.object.leads_to(arm, now_s) || self.object.evidence().is_some_and(|evidence| evidence < 0.0)
    }

    /// Tracks the object alone, where it is known which thing that is.
    pub fn follow(
        &mut self,
        view: &View<'_>,
        reference: &ReferenceModel,
        estimator: &mut dyn PoseEstimator,
    ) -> Option<ObjectPose> {
        let expected = self.object.expected_pose(view.capture_s());
        let mut pose = estimator.estimate(view, expected.into()).ok()?;
        if let Some(T) = estimator.turned_over() {
            self.object.poses.iter_mut().for_each(|it| it.X_WO *= T);
            self.object.flight = None;
        } else if self.object.distance_m(&pose, reference.radius_m).is_none() {
            // Another object, or this one at another place.
            self.object.poses.clear();
            self.object.flight = None;
        } else if let Some(X_WO) = &expected {
            pose.X_WO.rotation = reference.symmetry.nearest_alike(&X_WO.rotation, &pose.X_WO.rotation);
        }
        self.object.remember(pose);
        Some(pose)
    }

    /// Tracks all that could be the object.
    pub fn search(
        &mut self,
        view: &View<'_>,
        reference: &ReferenceModel,
        estimator: &mut dyn PoseEstimator,
    ) -> Option<ObjectPose> {
        let Self { object, others, is_followed, .. } = self;
        let now_s = view.capture_s();
        let expected: Vec<Pose> =
            std::iter::once(&*object).chain(&*others).filter_map(|it| it.expected_pose(now_s)).collect();
        let mut found = Vec::new();
        estimator.estimate_all(view, &expected, &mut found);
        let (mut left, mut new): (Vec<&mut Track>, _) =
            (std::iter::once(&mut *object).chain(&mut *others).collect(), Vec::new());
        for mut pose in found {
            let near =
                left.iter().enumerate().filter_map(|(i, it)| Some((i, it.distance_m(&pose, reference.radius_m)?)));
            let Some((i, _)) = near.min_by(|a, b| a.1.total_cmp(&b.1)) else {
                new.push(Track { poses: vec![pose], flight: None });
                continue;
            };
            let track = left.swap_remove(i);
            if let Some(X_WO) = track.expected_pose(now_s) {
                pose.X_WO.rotation = reference.symmetry.nearest_alike(&X_WO.rotation, &pose.X_WO.rotation);
            }
            track.remember(pose);
        }
        // New things first, so that others which were seen now do not displace them.
        new.append(others);
        *others = new;
        others.retain(|it| it.seen_s() > now_s - FORGOTTEN_AFTER_S);
        others.sort_by(|a, b| b.seen_s().total_cmp(&a.seen_s()));
        others.truncate(MOST_OTHERS);
        if !*is_followed
            && now_s > object.seen_s() + LOST_AFTER_S
            && let Some(newer) = others.first_mut().filter(|it| it.seen_s() > object.seen_s())
        {
            std::mem::swap(object, newer);
        }
        object.poses.last().filter(|pose| pose.capture_s == now_s).copied()
    }

    /// Predicts the object's flight. As long as it does not fly, or not to the arm, another thing that does
    /// is the object.
    pub fn predict(&mut self, predictor: &mut dyn FlightPredictor, known: &Preparation) {
        let (symmetry, arm) = (&known.reference.symmetry, &known.search.motion);
        let are_labelled = self.unlabelled_s.is_none();
        let is_predicted = self.object.predict(predictor, symmetry).is_ok();
        self.flies = is_predicted && (are_labelled || self.is_followed || self.object.falls());
        self.is_followed = are_labelled || self.flies && self.object.leads_or_led_to(arm);
        if self.unlabelled_s.is_none_or(|now_s| self.followed(now_s).is_some()) {
            self.others.clear();
            return;
        }
        let leads = |it: &mut Track| it.predict(predictor, symmetry).is_ok() && it.falls() && it.leads_or_led_to(arm);
        if let Some(i) = self.others.iter_mut().position(leads) {
            std::mem::swap(&mut self.object, &mut self.others[i]);
            (self.flies, self.is_followed) = (true, true);
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use catch_cell::{DepthFrame, PixelWindow};
    use nalgebra::{Matrix6, Point3, Vector3};

    use super::*;
    use crate::{
        perception::{PerceptionStatus, Prior},
        tracker::tests::preparation,
    };

    pub fn pose(capture_s: f64, p_WO: Point3<f64>) -> ObjectPose {
        ObjectPose {
            capture_s,
            X_WO: p_WO.into(),
            information: Matrix6::identity() * 1e6,
            points: 10,
            residual_m: 0.0,
            points_mismatch: None,
            silhouette_mismatch: None,
            iterations: 1,
            registered_globally: false,
        }
    }

    /// A throw to the arm.
    pub fn thrown(time_s: f64) -> Point3<f64> {
        Point3::new(2.6 - 2.9 * time_s, 2.6 - 4.0 * time_s, 0.5 + 3.6 * time_s - 4.905 * time_s * time_s)
    }

    #[test]
    fn poses_are_forgotten_one_by_one() {
        let mut track = Track::default();
        // Every other image arrives late.
        (0..2 * POSES).for_each(|i| track.remember(pose((i ^ 1) as f64, Point3::origin())));
        assert_eq!(track.poses.len(), POSES);
        assert!(track.poses.iter().zip(POSES..).all(|(it, at)| it.capture_s == at as f64), "half a throw is lost");
    }

    #[test]
    fn before_there_is_a_flight_a_parabola_is_expected() {
        let mut track = Track::default();
        assert_eq!(track.expected_pose(0.0), None);
        track.remember(pose(0.0, thrown(0.0)));
        assert_eq!(track.expected_pose(0.02), Some(thrown(0.0).into()), "one pose tells no velocity");
        track.remember(pose(0.05, thrown(0.05)));
        let expected = track.expected_pose(0.08).unwrap().translation.vector;
        assert!((expected - thrown(0.08).coords).norm() < 1e-12, "{expected}");
    }

    #[test]
    fn a_flight_leads_to_the_arm_if_it_comes_near_above_the_floor() {
        let known = preparation();
        let leads = |p_WOcm: Point3<f64>, v_WOcm: Vector3<f64>| {
            let flight = FlightTrajectory { p_WOcm, v_WOcm, ..FlightTrajectory::default() };
            tracked(p_WOcm, flight).leads_or_led_to(&known.search.motion)
        };
        let (from, to_arm) = (Point3::new(3.0, 0.0, 1.0), Vector3::new(-5.0, 0.0, 2.0));
        assert!(leads(from, to_arm));
        assert!(!leads(from, -to_arm), "it flies away");
        assert!(!leads(from, Vector3::new(-1.0, 0.0, 0.0)), "it falls to the floor before");
        assert!(!leads(Point3::new(3.0, 0.0, 4.0), Vector3::new(-9.0, 0.0, 9.0)), "it passes above");
        let flight = FlightTrajectory {
            time_s: 1.0,
            p_WOcm: [-2.0, 0.0, 0.095].into(),
            v_WOcm: [-5.0, 0.0, -5.81].into(),
            ..FlightTrajectory::default()
        };
        let track = tracked(from, flight);
        assert!(track.leads_or_led_to(&known.search.motion), "it has passed the arm");
        let flight = FlightTrajectory { time_s: 3.0, p_WOcm: from, v_WOcm: to_arm, ..FlightTrajectory::default() };
        let track = tracked(from, flight);
        assert!(track.leads_or_led_to(&known.search.motion), "it was seen long before");
    }

    /// A thing that was seen once, and its flight.
    fn tracked(p_WO: Point3<f64>, flight: FlightTrajectory) -> Track {
        Track { poses: vec![pose(0.0, p_WO)], flight: Some(flight) }
    }

    /// Sees a hand from the first image on, and what is thrown, if anything, from the third.
    struct HandAndObject {
        hand: fn(f64) -> Point3<f64>,
        is_thrown: bool,
    }

    impl PoseEstimator for HandAndObject {
        fn estimate(&mut self, view: &View<'_>, prior: Prior) -> Result<ObjectPose, PerceptionStatus> {
            let mut all = Vec::new();
            self.estimate_all(view, &[], &mut all);
            let from_m = |it: &ObjectPose| (it.X_WO.inverse() * prior.pose().unwrap()).translation.vector.norm();
            all.into_iter().min_by(|a, b| from_m(a).total_cmp(&from_m(b))).ok_or(PerceptionStatus::NoPoints)
        }

        fn estimate_all(&mut self, view: &View<'_>, _: &[Pose], found: &mut Vec<ObjectPose>) {
            let time_s = view.capture_s();
            found.push(pose(time_s, (self.hand)(time_s)));
            found.extend((self.is_thrown && time_s > 0.015).then(|| pose(time_s, thrown(time_s))));
        }
    }

    /// Tracks what is in images a hundredth of a second apart, and hands over what came of each.
    fn track(estimator: &mut HandAndObject, images: u32, mut each: impl FnMut(f64, &Tracks)) {
        let known = preparation();
        let (mut tracks, mut predictor) = (Tracks::new(), known.flight_predictor(1));
        for i in 0..images {
            let time_s = 0.01 * f64::from(i);
            tracks.unlabelled_s = Some(time_s);
            let window = PixelWindow::default();
            let frames = [DepthFrame { camera: 0, capture_s: time_s, window, depth_m: Vec::new(), mask: None }];
            let view = View { frames: &frames, ..View::default() };
            match tracks.followed(time_s) {
                Some(_) => tracks.follow(&view, &known.reference, estimator),
                None => tracks.search(&view, &known.reference, estimator),
            };
            tracks.predict(&mut predictor, &known);
            each(time_s, &tracks);
        }
    }

    #[test]
    fn what_flies_to_the_arm_is_the_object_whatever_was_seen_before() {
        let hand = |time_s: f64| Point3::new(2.0, -1.4 - 1.5 * time_s, 0.9);
        let mut nearest = Vec::new();
        track(&mut HandAndObject { hand, is_thrown: true }, 12, |time_s, tracks| {
            let p_WO = Point3::from(tracks.object.poses.last().unwrap().X_WO.translation.vector);
            nearest.push(if nalgebra::distance(&p_WO, &thrown(time_s)) < 1e-9 { "object" } else { "hand" });
            let flies = tracks.flies;
            assert_eq!(flies, nearest.ends_with(&["object"]));
            assert_eq!(flies, tracks.followed(time_s).is_some());
            let is_mixed = tracks.object.poses.iter().any(|it| it.X_WO != thrown(it.capture_s).into());
            assert!(!flies || !is_mixed, "poses are mixed");
        });
        // The object is seen from the third image on, and seven poses tell that gravity bends its path.
        let (before, after) = nearest.split_at(8);
        assert_eq!((before, after), (&["hand"; 8][..], &["object"; 4][..]));
    }

    #[test]
    fn a_hand_that_comes_to_the_arm_does_not_fly() {
        let hand = |time_s: f64| Point3::new(1.6 - 1.2 * time_s, 0.2, 0.9);
        let (known, mut predicted) = (preparation(), 0);
        track(&mut HandAndObject { hand, is_thrown: false }, 60, |time_s, tracks| {
            assert!(!tracks.flies && tracks.followed(time_s).is_none(), "{time_s}");
            predicted += usize::from(tracks.object.leads_or_led_to(&known.search.motion));
        });
        assert!(predicted > 10, "some flights were near its path, and led to the arm: {predicted}");
    }
}
