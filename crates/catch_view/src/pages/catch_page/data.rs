//! Data of a throw's page.

use catch_body::{Pose, Robot, shape::Capsule};
use catch_bot::grasp_selection::RankedGrasp;
use nalgebra::Point3;
use serde::Serialize;

use crate::{
    pages::packed::Packed,
    playback::{MotionSample, Playback},
    surfaces::surfaces,
    viewpoint::{CatchScene, Viewpoint},
};
use catch_lab::{VERSION, recording::throw_times::TickTimes, referee::reason::Reason, scenario::setup::Scene};
use catch_recording::RecordedTick;

use super::{
    contacts::{TouchedPart, contacts},
    points::PackedPoints,
    predictions::{Errors, Predictions, is_news},
    surfaces::PackedSurface,
};

/// Samples of the motion at most.
const MOST_SAMPLES: usize = 1500;
/// Candidates for a grasp that are shown of each tick.
const CANDIDATES: usize = 16;

/// All that the page's scripts read. Poses are (x, y, z, qx, qy, qz, qw); times count from the beginning of
/// the recording.
#[derive(Debug, Serialize)]
pub struct PageData {
    version: &'static str,
    /// Scene of the throw; `None` for a real cell.
    scene: Option<Scene>,
    /// `None` where the outcome is unknown.
    caught: Option<bool>,
    /// Reason of the miss.
    reason: Option<String>,
    facts: Vec<(&'static str, String)>,
    events: Vec<Event>,
    end_s: f64,
    flight_end_s: f64,
    /// Of many throws one looks at the putting down, too.
    shows_all: bool,
    scene_view: Option<View>,
    close_up_view: Option<View>,
    robot: RobotData,
    pub(in crate::pages) surfaces: Vec<PackedSurface>,
    motion: Motion,
    predictions: Predictions,
    errors: Errors,
    plans: Vec<Plan>,
    contacts: Vec<TouchedPart>,
    candidates: Vec<Candidates>,
    points: PackedPoints,
    cameras: Vec<Camera>,
    stages: Option<Stages>,
    links: Option<Links>,
}

/// Pages beside this one, where it is one of a report's.
#[derive(Debug, Serialize)]
pub struct Links {
    /// The report.
    pub report: String,
    /// The miss before this one.
    pub previous: Option<String>,
    /// The miss after this one.
    pub next: Option<String>,
    /// The nearest throw that was caught.
    pub caught: Option<String>,
    /// Of a caught one, the miss that it is near to.
    pub missed: Option<String>,
}

#[derive(Debug, Serialize)]
struct Event {
    time_s: f64,
    label: &'static str,
    detail: String,
}

/// A viewpoint on the catch.
#[derive(Debug, Clone, Copy, Serialize)]
struct View {
    azimuth: f64,
    elevation: f64,
    radius_m: f64,
}

#[derive(Debug, Serialize)]
struct RobotData {
    base: [f64; 7],
    gripper: [f64; 7],
    joints: Vec<JointData>,
    capsules: Vec<CapsuleData>,
    finger_centre_y_m: f64,
    finger_thickness_m: f64,
    finger_tip_y_m: f64,
    palm_y_m: f64,
}

#[derive(Debug, Serialize)]
struct JointData {
    name: String,
    parent: [f64; 7],
    axis: [f64; 3],
}

/// A capsule around a part of a link.
#[derive(Debug, Serialize)]
struct CapsuleData {
    link: usize,
    from: [f64; 3],
    to: [f64; 3],
    radius: f64,
}

/// The true motion, or without ground truth the sensed one, at even times; what is unknown is `None`.
#[derive(Debug, Serialize)]
struct Motion {
    step_s: f64,
    q: Packed,
    width_m: Packed,
    p_WO: Option<Packed>,
    /// Orientation of the object as a quaternion.
    R_WO: Option<Packed>,
    /// Fractions of the joints' limits, 1 being the limit.
    position_ratio: Packed,
    velocity_ratio: Packed,
    acceleration_ratio: Packed,
    torque_ratio: Option<Packed>,
    finger_force_n: Packed,
}

/// A plan, from when it was made.
#[derive(Debug, Serialize)]
struct Plan {
    time_s: f64,
    catch_s: f64,
    hand: [f64; 7],
    width_m: f64,
    /// Point of the hand at which it means to hold the object's centre of mass, in G.
    held: [f64; 3],
}

/// The best grasps for the flight as it was predicted: poses of the gripper in the world at the catch.
#[derive(Debug, Serialize)]
struct Candidates {
    time_s: f64,
    hands: Vec<[f32; 7]>,
}

#[derive(Debug, Serialize)]
struct Camera {
    pose: [f64; 7],
    /// Half the image's width and height at a depth of 1 m.
    half: [f64; 2],
}

#[derive(Debug, Serialize)]
struct Stages {
    names: Vec<String>,
    time_s: Vec<f64>,
    /// Durations in milliseconds, per tick one number per name; −1 where the stage did not run.
    ms: Packed,
}

impl PageData {
    /// Gathers what the page of a throw shows, with at most so many points of its images.
    pub fn of(playback: &Playback, points: usize) -> Self {
        let Playback { header, ending, robot, gripper, .. } = playback;
        let ground_truth = playback.ground_truth();
        let verdict = ground_truth.map(|it| &it.verdict);
        let start_s = playback.start_s();
        let scene = CatchScene::new(playback);
        let events = ending.timeline.iter().map(|entry| Event {
            time_s: entry.time_s - start_s,
            label: entry.event.label(),
            detail: entry.detail.clone(),
        });
        let camera = |camera: &catch_cell::CameraModel| Camera {
            pose: seven(&camera.X_WC),
            half: [camera.width_px, camera.height_px].map(|size| f64::from(size) / 2.0 / camera.focal_px),
        };
        Self {
            version: VERSION,
            scene: header.simulation.as_ref().map(|it| it.scene.clone()),
            caught: verdict.map(|it| it.caught),
            reason: verdict.and_then(|it| it.reason.as_ref()).map(Reason::to_string),
            facts: facts(playback),
            events: events.collect(),
            end_s: playback.end_s() - start_s,
            flight_end_s: playback.flight_end_s() - start_s,
            shows_all: header.simulation.as_ref().is_some_and(|it| it.thrown_s.is_some()),
            scene_view: scene.as_ref().map(|it| View::from(it.scene())),
            close_up_view: scene.as_ref().map(|it| View::from(it.close_up())),
            robot: RobotData::of(robot, gripper),
            surfaces: surfaces(robot, gripper, ground_truth.map(|it| it.surface.mesh()).as_ref())
                .into_iter()
                .map(PackedSurface::from)
                .collect(),
            motion: Motion::of(playback),
            predictions: Predictions::of(playback),
            errors: Errors::of(playback),
            plans: playback.ticks.iter().filter_map(|tick| plan_of(playback, tick)).collect(),
            contacts: contacts(playback),
            candidates: candidates(playback),
            points: PackedPoints::of(playback, points),
            cameras: header.cell.cameras.iter().map(camera).collect(),
            stages: Stages::of(playback),
            links: None,
        }
    }
}

impl PageData {
    /// The data with the way to other pages.
    pub fn among(self, links: Links) -> Self {
        Self { links: Some(links), ..self }
    }

    /// The data with the first view of another throw, for two throws beside each other.
    pub fn seen_as(self, other: &Self) -> Self {
        Self { scene_view: other.scene_view, ..self }
    }
}

/// Measures of the referee, for people; without ground truth, the clock of the page's times.
fn facts(playback: &Playback) -> Vec<(&'static str, String)> {
    let Some(verdict) = playback.ground_truth().map(|it| &it.verdict) else {
        return vec![("Begins on the cell's clock at", format!("{:.3} s", playback.start_s()))];
    };
    let measures = &verdict.measures;
    let percent = |ratio: f64| format!("{:.0} %", ratio * 100.0);
    let mut facts = Vec::new();
    if let Some(error_m) = measures.prediction_error_m {
        facts.push(("Prediction off by", format!("{:.3} mm", error_m * 1e3)));
    }
    if let Some(error_m) = measures.tracking_error_m {
        facts.push(("Hand off its plan by", format!("{:.3} mm", error_m * 1e3)));
    }
    if let Some(travel_rad) = measures.joint_travel_rad {
        facts.push(("Joint travel", format!("{travel_rad:.2} rad")));
    }
    facts.push(("Peak joint velocity", percent(measures.peak_velocity_ratio)));
    facts.push(("Peak torque", percent(measures.peak_torque_ratio)));
    facts.push(("Limits broken by commands", verdict.limit_violations.to_string()));
    facts.push(("Limits exceeded by the motion", verdict.motion_excursions.to_string()));
    facts
}

/// A pose as seven numbers.
pub(crate) fn seven(X_AB: &Pose) -> [f64; 7] {
    let (p, q) = (&X_AB.translation.vector, X_AB.rotation.coords);
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
}

impl From<Viewpoint> for View {
    fn from(Viewpoint { azimuth_rad, elevation_rad, radius_m, .. }: Viewpoint) -> Self {
        Self { azimuth: azimuth_rad, elevation: elevation_rad, radius_m }
    }
}

impl RobotData {
    fn of(robot: &Robot, gripper: &catch_body::Gripper) -> Self {
        let joints = robot.joints.iter().map(|joint| JointData {
            name: joint.name.clone(),
            parent: seven(&joint.X_PL),
            axis: joint.axis.into_inner().into(),
        });
        let capsule = |(link, it): &(usize, Capsule)| CapsuleData {
            link: *link,
            from: it.from.into(),
            to: it.to.into(),
            radius: it.radius,
        };
        Self {
            base: seven(&robot.X_WB),
            gripper: seven(&robot.X_LG),
            joints: joints.collect(),
            capsules: robot.capsules.iter().map(capsule).collect(),
            finger_centre_y_m: gripper.finger_centre_y_m,
            finger_thickness_m: gripper.finger_size_m[0],
            finger_tip_y_m: gripper.fingertip_y_m(),
            palm_y_m: gripper.palm_y_m(),
        }
    }
}

impl Motion {
    fn of(playback: &Playback) -> Self {
        let samples: Vec<MotionSample> = match playback.ground_truth() {
            Some(it) => {
                let all = &it.truth.samples;
                let stride = all.len().div_ceil(MOST_SAMPLES).max(2);
                all.iter().step_by(stride).map(MotionSample::from).collect()
            }
            None => sensed(playback),
        };
        let times_s: Vec<f64> = samples.iter().map(|sample| sample.time_s).collect();
        let ddq = playback.commanded_accelerations(&times_s);
        let joints = &playback.robot.joints;
        let pack = |columns: usize, row: &dyn Fn(usize, &MotionSample) -> Vec<f64>| {
            let values: Vec<f64> = samples.iter().enumerate().flat_map(|(i, sample)| row(i, sample)).collect();
            Packed::numbers(&values, columns)
        };
        let pack_poses = |columns: usize, row: &dyn Fn(&Pose) -> Vec<f64>| {
            let poses: Option<Vec<Pose>> = samples.iter().map(|sample| sample.X_WO).collect();
            let values = |poses: Vec<Pose>| poses.iter().flat_map(row).collect::<Vec<f64>>();
            poses.map(|poses| Packed::numbers(&values(poses), columns))
        };
        let has_torque = samples.iter().all(|sample| sample.torque.is_some());
        let torque = |sample: &MotionSample, joint: usize| sample.torque.map_or(0.0, |torque| torque[joint]);
        let per_joint = |value: &dyn Fn(usize, &MotionSample, usize) -> f64| {
            pack(joints.len(), &|i, sample| (0..joints.len()).map(|joint| value(i, sample, joint)).collect())
        };
        Self {
            step_s: times_s.get(1).map_or(0.001, |second| second - times_s[0]),
            q: per_joint(&|_, sample, joint| sample.q[joint]),
            width_m: pack(1, &|_, sample| vec![sample.width_m]),
            p_WO: pack_poses(3, &|X_WO| X_WO.translation.vector.as_slice().to_vec()),
            R_WO: pack_poses(4, &|X_WO| X_WO.rotation.coords.as_slice().to_vec()),
            position_ratio: per_joint(&|_, sample, joint| {
                let limits = &joints[joint].limits;
                (sample.q[joint] - f64::midpoint(limits.lower, limits.upper)) / ((limits.upper - limits.lower) / 2.0)
            }),
            velocity_ratio: per_joint(&|_, sample, joint| {
                sample.dq[joint] / joints[joint].max_speed(sample.q[joint], sample.dq[joint])
            }),
            acceleration_ratio: per_joint(&|i, _, joint| ddq[i][joint] / joints[joint].limits.acceleration),
            torque_ratio: has_torque
                .then(|| per_joint(&|_, sample, joint| torque(sample, joint) / joints[joint].limits.torque)),
            finger_force_n: pack(2, &|_, sample| sample.finger_force_n.to_vec()),
        }
    }
}

/// The sensed motion at even times, no more than there are observations.
fn sensed(playback: &Playback) -> Vec<MotionSample> {
    let last = playback.ticks.len().clamp(2, MOST_SAMPLES) - 1;
    let (start_s, end_s) = (playback.start_s(), playback.end_s());
    let at = |i: usize| start_s + (end_s - start_s) * i as f64 / last as f64;
    (0..=last).filter_map(|i| Some(MotionSample { time_s: at(i), ..playback.motion_at(at(i))? })).collect()
}

fn plan_of(playback: &Playback, tick: &RecordedTick) -> Option<Plan> {
    let plan = tick.report.plan.as_ref().filter(|_| tick.report.status.is_new_motion())?;
    let [time_s, catch_s] = [tick.observation.time_s, plan.catch_s].map(|time_s| time_s - playback.start_s());
    let com_W = tick.report.flight.as_ref()?.pose_at(plan.catch_s) * playback.com_O();
    let held = plan.X_WG.inverse_transform_point(&com_W).into();
    Some(Plan { time_s, catch_s, hand: seven(&plan.X_WG), width_m: plan.aperture_m, held })
}

fn candidates(playback: &Playback) -> Vec<Candidates> {
    let config = &playback.header.cell.brain.grasp_selection;
    let base = Point3::from(playback.robot.X_WB.translation.vector);
    let of_tick = |tick: &RecordedTick| {
        let (flight, plan) = tick.report.flight.as_ref().filter(|_| is_news(tick)).zip(tick.report.plan.as_ref())?;
        let (X_WO, V_WO) = (flight.pose_at(plan.catch_s), flight.twist_at(plan.catch_s));
        let ranked = playback.known.grasps.rank(&X_WO, &V_WO.linear, &base, config, |_| true).0;
        // A tenth of a millimetre is plenty for a picture.
        let rounded = |it: &RankedGrasp| seven(&it.X_WG).map(|value| (value * 1e4).round() as f32 / 1e4);
        let hands = ranked.iter().take(CANDIDATES).map(rounded).collect();
        Some(Candidates { time_s: tick.observation.time_s - playback.start_s(), hands })
    };
    playback.ticks.iter().filter_map(of_tick).collect()
}

impl Stages {
    fn of(playback: &Playback) -> Option<Self> {
        let times = playback.times.as_ref()?;
        let mut names: Vec<String> = Vec::new();
        for (name, _) in times.ticks.iter().flat_map(|tick| &tick.stage_ms) {
            if !names.contains(name) {
                names.push(name.clone());
            }
        }
        let row = |tick: &TickTimes| -> Vec<f64> {
            let of = |name: &String| tick.stage_ms.iter().find(|(it, _)| it == name).map_or(-1.0, |(_, ms)| *ms);
            names.iter().map(of).collect()
        };
        let ms: Vec<f64> = times.ticks.iter().flat_map(row).collect();
        let time_s = times.ticks.iter().map(|tick| tick.time_s - playback.start_s()).collect();
        Some(Self { ms: Packed::numbers(&ms, names.len().max(1)), names, time_s })
    }
}
