//! Viewpoints from which a catch is seen: of a ring around it the one that sees most of hand and object.
//!
//! There are two. The *scene* shows arm and flight, the *close-up* hand and object. Both are chosen at the
//! catch; pages and moving pictures share them. Links and surroundings before the hand are drawn transparent,
//! so they weigh less than hand and object, which hide each other.

use catch_body::{
    Pose, Robot,
    pose::look_at,
    ray_cast::{ArmSurface, RayCaster, SurfacePart},
};
use catch_cell::{
    CameraModel,
    sight::{DepthBuffer, Sight},
};
use nalgebra::{Point3, Vector2, Vector3};
use serde::Serialize;

use crate::playback::{MotionSample, Playback};

/// Vertical field of view, also of the pages.
const VIEW_RAD: f64 = 0.72;
/// Fraction of a picture that the throw fills.
const FILL: f64 = 0.84;
/// Viewpoints around the vertical axis.
const AZIMUTHS: usize = 24;
/// Elevations of the scene's ring.
const SCENE_RAD: [f64; 3] = [0.16, 0.36, 0.62];
/// Elevations of the close-up's ring.
const CLOSE_UP_RAD: [f64; 5] = [-0.1, 0.15, 0.45, 0.8, 1.15];
/// Pixels of a look in each direction.
const LOOK_PX: u32 = 40;
/// Nominal size of a page's scene; only its ratio counts.
const PAGE_PX: [u16; 2] = [1300, 1000];
/// Fraction of the close-up that the object covers at least.
const CLOSE_UP_COVER: f64 = 0.06;
/// Radius of a close-up over that of the hand, at least.
const NEAREST: f64 = 0.5;
/// Weight of what stands before hand and object over that of the object.
const BEFORE: f64 = 0.4;
/// Weight of a look along the axis across closing direction and approach.
const ACROSS_HAND: f64 = 0.8;
/// Weight of a look across the flight.
const ACROSS_FLIGHT: f64 = 0.5;

/// Pixels of hand and object from a viewpoint at the catch.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Seen {
    /// Fraction of the hand's pixels with nothing opaque before them.
    pub hand: f64,
    /// Fraction of the object's pixels with nothing opaque before them; 1 where no object is known.
    pub object: f64,
    /// Fraction of the pixels of both behind links or surroundings, which are drawn transparent.
    pub behind_others: f64,
    /// Fraction of the look that the object would cover, were nothing before it.
    pub object_cover: f64,
}

/// A viewpoint.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Viewpoint {
    /// Azimuth of the camera from the point that it looks at, in radians.
    #[serde(rename = "azimuth")]
    pub azimuth_rad: f64,
    /// Elevation of the camera above the horizon, in radians.
    #[serde(rename = "elevation")]
    pub elevation_rad: f64,
    /// Half the height of what is shown around hand and object, in metres.
    pub radius_m: f64,
    /// Pixels seen at the catch.
    #[serde(skip)]
    pub seen: Seen,
}

impl Viewpoint {
    /// Direction from the point that is looked at to the camera.
    pub fn away(&self) -> Vector3<f64> {
        let (azimuth, elevation) = (self.azimuth_rad, self.elevation_rad);
        let [level, up] = [libm::cos(elevation), libm::sin(elevation)];
        Vector3::new(level * libm::cos(azimuth), level * libm::sin(azimuth), up)
    }

    /// A camera that shows a ball around `centre` from here.
    pub fn around(&self, centre: &Point3<f64>, radius_m: f64, [width_px, height_px]: [u32; 2]) -> CameraModel {
        let distance_m = radius_m / libm::tan(VIEW_RAD / 2.0);
        let X_WC = look_at(&(centre + self.away() * distance_m), centre);
        CameraModel::with_field_of_view(X_WC, width_px, height_px, VIEW_RAD)
    }
}

/// Hand, object and all around them at the catch.
#[derive(Debug)]
pub struct CatchScene<'a> {
    playback: &'a Playback,
    sample: MotionSample,
    arm: ArmSurface,
    object: Option<RayCaster>,
    /// Points of the throw that the scene shows.
    points: Vec<Point3<f64>>,
    /// Direction of the object's flight.
    flight: Vector3<f64>,
}

impl<'a> CatchScene<'a> {
    /// The scene at the catch; `None` for a recording without motion.
    pub fn new(playback: &'a Playback) -> Option<Self> {
        let sample = playback.motion_at(playback.flight_end_s())?;
        let path = path(playback);
        let flight = path.last().zip(path.first()).map_or_else(Vector3::x, |(last, first)| last - first);
        Some(Self {
            playback,
            sample,
            arm: ArmSurface::new(&playback.robot, &playback.gripper),
            object: playback.ground_truth().map(|it| RayCaster::new(&it.surface.mesh())),
            points: framed_points(playback, path),
            flight,
        })
    }

    /// Radius of a ball that holds the hand's fingers.
    fn hand_radius_m(&self) -> f64 {
        let gripper = &self.playback.gripper;
        0.8 * libm::hypot(gripper.max_width_m / 2.0 + gripper.finger_size_m[0], gripper.fingertip_y_m())
    }

    /// The point between hand and object that a look shows, and the radius of the ball that holds both.
    fn focus(&self) -> (Point3<f64>, f64) {
        between(self.playback, &self.sample, self.hand_radius_m())
    }

    /// The best viewpoint of arm and flight.
    pub fn scene(&self) -> Viewpoint {
        let across = self.flight.cross(&Vector3::z()).try_normalize(1e-9).unwrap_or_else(Vector3::x);
        best(&SCENE_RAD, |view| {
            (self.seen_from(&self.eye(view), LOOK_PX), ACROSS_FLIGHT * view.away().dot(&across).abs())
        })
    }

    /// Where the camera of a page stands for a view of arm and flight.
    pub fn eye(&self, view: &Viewpoint) -> Point3<f64> {
        self.framed(view, PAGE_PX).X_WC.translation.vector.into()
    }

    /// The best viewpoint of hand and object, as near as shows both and the object large.
    pub fn close_up(&self) -> Viewpoint {
        let (centre, shown_m) = self.focus();
        let across = self.sample.X_WG.rotation * Vector3::z();
        let mut view = best(&CLOSE_UP_RAD, |view| {
            let eye = view.around(&centre, shown_m, [LOOK_PX; 2]).X_WC.translation.vector.into();
            (self.seen_from(&eye, LOOK_PX), ACROSS_HAND * view.away().dot(&across).abs())
        });
        // A small object is shown from nearer.
        let cover = view.seen.object_cover * view.seen.object;
        let nearer = if cover > 0.0 { (cover / CLOSE_UP_COVER).sqrt().clamp(NEAREST, 1.0) } else { 1.0 };
        let gap_m = shown_m - self.hand_radius_m();
        view.radius_m = (shown_m * nearer - gap_m).max(self.hand_radius_m() * NEAREST);
        view.seen.object_cover *= (shown_m / (view.radius_m + gap_m)).powi(2);
        view
    }

    /// Pixels that are seen at the catch from a point, `size_px` in each direction around hand and object.
    pub fn seen_from(&self, eye: &Point3<f64>, size_px: u32) -> Seen {
        let (centre, radius_m) = self.focus();
        let view_rad = 2.0 * libm::atan(radius_m / (centre - eye).norm());
        let camera = CameraModel::with_field_of_view(look_at(eye, &centre), size_px, size_px, view_rad);
        let X_WL = self.playback.robot.link_poses(&self.sample.q);
        let (hand, others): (Vec<_>, Vec<_>) =
            self.arm.named_parts(&X_WL, self.sample.width_m).partition(|(part, ..)| *part == SurfacePart::Gripper);
        let of = |parts: &[(SurfacePart, Pose, &RayCaster)]| {
            let sights: Vec<Sight> = parts.iter().map(|(_, X_WB, caster)| Sight::new(&camera, X_WB, caster)).collect();
            nearest(&camera, &sights)
        };
        let object = self.sample.X_WO.iter().zip(&self.object);
        let object: Vec<Sight> = object.map(|(X_WO, caster)| Sight::new(&camera, X_WO, caster)).collect();
        Seen::of(&of(&hand), &nearest(&camera, &object), &of(&others))
    }

    /// A camera that shows all points of the throw from a direction, as near as it can be.
    pub fn framed(&self, view: &Viewpoint, [width_px, height_px]: [u16; 2]) -> CameraModel {
        let (points, away) = (&self.points, view.away());
        let mut target = Point3::from(points.iter().map(|it| it.coords).sum::<Vector3<f64>>() / points.len() as f64);
        let mut distance_m = 4.0;
        let camera = |target: &Point3<f64>, distance_m: f64| {
            let X_WC = look_at(&(target + away * distance_m), target);
            CameraModel::with_field_of_view(X_WC, u32::from(width_px), u32::from(height_px), VIEW_RAD)
        };
        for _ in 0..12 {
            let model = camera(&target, distance_m);
            let seen: Vec<_> =
                points.iter().filter_map(|p_W| model.project(&model.X_WC.inverse_transform_point(p_W))).collect();
            let low = seen.iter().fold(Vector2::repeat(f64::INFINITY), |low, uv| low.inf(&uv.coords));
            let high = seen.iter().fold(Vector2::repeat(f64::NEG_INFINITY), |high, uv| high.sup(&uv.coords));
            let (middle, size) = ((low + high) / 2.0, high - low);
            let offset_C = (middle - Vector2::from(model.principal_px)) * (distance_m / model.focal_px);
            target += model.X_WC.rotation * offset_C.push(0.0);
            let fill = (size.x / f64::from(width_px)).max(size.y / f64::from(height_px)) / FILL;
            distance_m = (distance_m * fill).clamp(0.8, 20.0);
        }
        camera(&target, distance_m)
    }
}

impl Seen {
    /// Counts pixels by the depths of hand, object and others.
    fn of(hand: &[Option<f64>], object: &[Option<f64>], others: &[Option<f64>]) -> Self {
        let is_before = |a: &Option<f64>, b: &Option<f64>| matches!((a, b), (Some(a), Some(b)) if a < b);
        let fraction_of = |part: &[Option<f64>], before: &[Option<f64>]| {
            let pixels = part.iter().flatten().count();
            let hidden = part.iter().zip(before).filter(|(part, before)| is_before(before, part)).count();
            if pixels == 0 { 1.0 } else { (pixels - hidden) as f64 / pixels as f64 }
        };
        let both: Vec<Option<f64>> = hand.iter().zip(object).map(|(hand, object)| hand.or(*object)).collect();
        Self {
            hand: fraction_of(hand, object),
            object: fraction_of(object, hand),
            behind_others: 1.0 - fraction_of(&both, others),
            object_cover: object.iter().flatten().count() as f64 / object.len().max(1) as f64,
        }
    }

    /// Value of a look at hand and object.
    fn value(&self) -> f64 {
        self.hand + self.object - BEFORE * self.behind_others
    }
}

/// The point to look at between hand and object, and the radius to show around it: the farther they are
/// apart, the more, up to five times the `radius_m` of the hand.
pub fn between(playback: &Playback, sample: &MotionSample, radius_m: f64) -> (Point3<f64>, f64) {
    let hand = sample.X_WG * playback.gripper.grasp_centre();
    let away = sample.X_WO.map_or_else(Vector3::zeros, |X_WO| X_WO.translation.vector - hand.coords);
    let gap_m = (away.norm() / 2.0).min(4.0 * radius_m);
    (hand + away.cap_magnitude(gap_m), radius_m + gap_m)
}

/// A camera that shows an arm with the room around it, from before it.
pub fn overview(robot: &Robot, size_px: [u32; 2]) -> CameraModel {
    let reach_m = robot.length_m();
    let view = Viewpoint { azimuth_rad: 0.7, elevation_rad: 0.3, radius_m: 1.25 * reach_m, seen: Seen::default() };
    let centre = Point3::from(robot.X_WB.translation.vector + Vector3::z() * 0.6 * reach_m);
    view.around(&centre, view.radius_m, size_px)
}

/// The viewpoint of a ring whose look and bonus are worth most.
fn best(elevations_rad: &[f64], look: impl Fn(&Viewpoint) -> (Seen, f64)) -> Viewpoint {
    let azimuths = (0..AZIMUTHS).map(|i| std::f64::consts::TAU * i as f64 / AZIMUTHS as f64);
    let ring = azimuths.flat_map(|azimuth_rad| elevations_rad.iter().map(move |it| (azimuth_rad, *it)));
    let looks = ring.map(|(azimuth_rad, elevation_rad)| {
        let mut view = Viewpoint { azimuth_rad, elevation_rad, radius_m: 0.0, seen: Seen::default() };
        let (seen, bonus) = look(&view);
        view.seen = seen;
        (view, seen.value() + bonus)
    });
    let first = Viewpoint { azimuth_rad: 0.0, elevation_rad: elevations_rad[0], radius_m: 0.0, seen: Seen::default() };
    let best = looks.fold((first, f64::NEG_INFINITY), |best, it| if it.1 > best.1 { it } else { best });
    best.0
}

/// Depth of the nearest surface behind each pixel.
fn nearest(camera: &CameraModel, sights: &[Sight]) -> Vec<Option<f64>> {
    let buffer = DepthBuffer::new(camera.full_window(), sights.iter().copied());
    buffer.pixels().map(|pixel| pixel.map(|(_, hit)| hit.t)).collect()
}

/// The object's path until the catch, as it was or as it was seen.
fn path(playback: &Playback) -> Vec<Point3<f64>> {
    let seen = playback.ticks.iter().filter_map(|tick| tick.report.pose.map(|pose| pose.X_WO));
    match playback.ground_truth() {
        Some(_) => samples(playback).filter_map(|it| it.X_WO).map(|X_WO| X_WO.translation.vector.into()).collect(),
        None => seen.map(|X_WO| X_WO.translation.vector.into()).collect(),
    }
}

fn samples(playback: &Playback) -> impl Iterator<Item = MotionSample> {
    let (from_s, until_s) = (playback.start_s(), playback.flight_end_s());
    (0..=20).filter_map(move |i| playback.motion_at(from_s + (until_s - from_s) * f64::from(i) / 20.0))
}

/// A path, and the arm at its beginning, middle and end.
fn framed_points(playback: &Playback, path: Vec<Point3<f64>>) -> Vec<Point3<f64>> {
    let base = Point3::from(playback.robot.X_WB.translation.vector);
    let mut points = path;
    points.extend([[-0.2, -0.2], [-0.2, 0.2], [0.2, -0.2], [0.2, 0.2]].map(|[x, y]| base + Vector3::new(x, y, 0.0)));
    for sample in samples(playback).step_by(10) {
        points.extend(playback.robot.link_poses(&sample.q).iter().map(|X_WL| Point3::from(X_WL.translation.vector)));
    }
    points
}
