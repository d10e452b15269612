//! Data of a throw's page.

use catch_body::{Gripper, Pose, Robot, robot::Joint, shape::Capsule};
use catch_bot::grasp_selection::RankedGrasp;
use catch_cell::CameraModel;
use nalgebra::Point3;
use serde_json::{Value, json};

use crate::{
    pages::packed::Packed,
    playback::{MotionSample, Playback},
    surfaces::surfaces,
    viewpoint::CatchScene,
};
use catch_lab::{VERSION, recording::throw_times::TickTimes, referee::reason::Reason};
use catch_recording::RecordedTick;

use super::{
    contacts::contacts,
    points::points_by_tick,
    predictions::{errors, is_news, predictions},
    surfaces::packed_surface,
};

/// Samples of the motion at most.
const MOST_SAMPLES: usize = 1500;
/// Candidates for a grasp that are shown of each tick.
const CANDIDATES: usize = 16;

/// All that the page's scripts read, with at most so many points of its images. Poses are (x, y, z, qx, qy,
/// qz, qw); times count from the beginning of the recording.
pub fn page_data(playback: &Playback, points: usize) -> Value {
    let Playback { header, ending, robot, gripper, .. } = playback;
    let ground_truth = playback.ground_truth();
    let verdict = ground_truth.map(|it| &it.verdict);
    let start_s = playback.start_s();
    let scene = CatchScene::new(playback);
    let events = ending
        .timeline
        .iter()
        .map(|entry| json!({ "time_s": entry.time_s - start_s, "label": entry.event.label(), "detail": entry.detail }));
    // Half the image's width and height at a depth of 1 m.
    let half =
        |camera: &CameraModel| [camera.width_px, camera.height_px].map(|size| f64::from(size) / 2.0 / camera.focal_px);
    let camera = |camera: &CameraModel| json!({ "pose": seven(&camera.X_WC), "half": half(camera) });
    let object = ground_truth.map(|it| it.surface.mesh());
    let surfaces = surfaces(robot, gripper, object.as_ref()).into_iter();
    json!({
        "version": VERSION,
        // Scene of the throw; null for a real cell.
        "scene": header.simulation.as_ref().map(|it| &it.scene),
        // Null where the outcome is unknown.
        "caught": verdict.map(|it| it.caught),
        // Reason of the miss.
        "reason": verdict.and_then(|it| it.reason.as_ref()).map(Reason::to_string),
        "facts": facts(playback),
        "events": events.collect::<Vec<_>>(),
        "end_s": playback.end_s() - start_s,
        "flight_end_s": playback.flight_end_s() - start_s,
        // Of many throws one looks at the putting down, too.
        "shows_all": header.simulation.as_ref().is_some_and(|it| it.thrown_s.is_some()),
        "scene_view": scene.as_ref().map(CatchScene::scene),
        "close_up_view": scene.as_ref().map(CatchScene::close_up),
        "robot": robot_data(robot, gripper),
        "surfaces": surfaces.map(|it| packed_surface(it.of, it.link, &it.mesh, Some(it.colour))).collect::<Vec<_>>(),
        "motion": motion(playback),
        "predictions": predictions(playback),
        "errors": errors(playback),
        "plans": playback.ticks.iter().filter_map(|tick| plan_of(playback, tick)).collect::<Vec<_>>(),
        "contacts": contacts(playback),
        "candidates": candidates(playback),
        "points": points_by_tick(playback, points),
        "cameras": header.cell.cameras.iter().map(camera).collect::<Vec<_>>(),
        "stages": stages(playback),
        // Pages beside this one, where it is one of a report's.
        "links": null,
    })
}

/// Measures of the referee, for people; without ground truth, the clock of the page's times.
fn facts(playback: &Playback) -> Vec<(&'static str, String)> {
    let Some(verdict) = playback.ground_truth().map(|it| &it.verdict) else {
        return vec![("Begins on the cell's clock at", format!("{:.3} s", playback.start_s()))];
    };
    let measures = &verdict.measures;
    let percent = |ratio: f64| format!("{:.0} %", ratio * 100.0);
    let mut facts = Vec::new();
    let off = |error_m: f64| format!("{:.3} mm", error_m * 1e3);
    facts.extend(measures.prediction_error_m.map(|it| ("Prediction off by", off(it))));
    facts.extend(measures.tracking_error_m.map(|it| ("Hand off its plan by", off(it))));
    facts.extend(measures.joint_travel_rad.map(|it| ("Joint travel", format!("{it:.2} rad"))));
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

/// A joint as pages place what it moves.
pub(crate) fn joint_data(joint: &Joint) -> Value {
    json!({ "name": joint.name, "parent": seven(&joint.X_PL), "axis": joint.axis.as_slice() })
}

fn robot_data(robot: &Robot, gripper: &Gripper) -> Value {
    let capsule = |(link, it): &(usize, Capsule)| {
        let [from, to] = [it.from, it.to].map(<[f64; 3]>::from);
        json!({ "link": link, "from": from, "to": to, "radius": it.radius })
    };
    json!({
        "base": seven(&robot.X_WB),
        "gripper": seven(&robot.X_LG),
        "joints": robot.joints.iter().map(joint_data).collect::<Vec<_>>(),
        "capsules": robot.capsules.iter().map(capsule).collect::<Vec<_>>(),
        "finger_centre_y_m": gripper.finger_centre_y_m,
        "finger_thickness_m": gripper.finger_size_m[0],
        "finger_tip_y_m": gripper.fingertip_y_m(),
        "palm_y_m": gripper.palm_y_m(),
    })
}

/// The true motion, or without ground truth the sensed one, at even times; what is unknown is null.
fn motion(playback: &Playback) -> Value {
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
    // Ratios are fractions of the joints' limits, 1 being the limit; `R_WO` is a quaternion.
    json!({
        "step_s": times_s.get(1).map_or(0.001, |second| second - times_s[0]),
        "q": per_joint(&|_, sample, joint| sample.q[joint]),
        "width_m": pack(1, &|_, sample| vec![sample.width_m]),
        "p_WO": pack_poses(3, &|X_WO| X_WO.translation.vector.as_slice().to_vec()),
        "R_WO": pack_poses(4, &|X_WO| X_WO.rotation.coords.as_slice().to_vec()),
        "position_ratio": per_joint(&|_, sample, joint| {
            let limits = &joints[joint].limits;
            (sample.q[joint] - f64::midpoint(limits.lower, limits.upper)) / ((limits.upper - limits.lower) / 2.0)
        }),
        "velocity_ratio": per_joint(&|_, sample, joint| {
            sample.dq[joint] / joints[joint].max_speed(sample.q[joint], sample.dq[joint])
        }),
        "acceleration_ratio": per_joint(&|i, _, joint| ddq[i][joint] / joints[joint].limits.acceleration),
        "torque_ratio": has_torque
            .then(|| per_joint(&|_, sample, joint| torque(sample, joint) / joints[joint].limits.torque)),
        "finger_force_n": pack(2, &|_, sample| sample.finger_force_n.to_vec()),
    })
}

/// The sensed motion at even times, no more than there are observations.
fn sensed(playback: &Playback) -> Vec<MotionSample> {
    let last = playback.ticks.len().clamp(2, MOST_SAMPLES) - 1;
    let (start_s, end_s) = (playback.start_s(), playback.end_s());
    let at = |i: usize| start_s + (end_s - start_s) * i as f64 / last as f64;
    (0..=last).filter_map(|i| Some(MotionSample { time_s: at(i), ..playback.motion_at(at(i))? })).collect()
}

/// A plan, from when it was made.
fn plan_of(playback: &Playback, tick: &RecordedTick) -> Option<Value> {
    let plan = tick.report.plan.as_ref().filter(|_| tick.report.status.is_new_motion())?;
    let [time_s, catch_s] = [tick.observation.time_s, plan.catch_s].map(|time_s| time_s - playback.start_s());
    let com_W = tick.report.flight.as_ref()?.pose_at(plan.catch_s) * playback.com_O();
    // Point of the hand at which it means to hold the object's centre of mass, in G.
    let held = <[f64; 3]>::from(plan.X_WG.inverse_transform_point(&com_W));
    let hand = seven(&plan.X_WG);
    Some(json!({ "time_s": time_s, "catch_s": catch_s, "hand": hand, "width_m": plan.aperture_m, "held": held }))
}

/// The best grasps for the flight as it was predicted: poses of the gripper in the world at the catch.
fn candidates(playback: &Playback) -> Vec<Value> {
    let config = &playback.header.cell.brain.grasp_selection;
    let base = Point3::from(playback.robot.X_WB.translation.vector);
    let of_tick = |tick: &RecordedTick| {
        let (flight, plan) = tick.report.flight.as_ref().filter(|_| is_news(tick)).zip(tick.report.plan.as_ref())?;
        let (X_WO, V_WO) = (flight.pose_at(plan.catch_s), flight.twist_at(plan.catch_s));
        let ranked = playback.known.grasps.rank(&X_WO, &V_WO.linear, &base, config, |_| true).0;
        // A tenth of a millimetre is plenty for a picture.
        let rounded = |it: &RankedGrasp| seven(&it.X_WG).map(|value| (value * 1e4).round() / 1e4);
        let hands: Vec<[f64; 7]> = ranked.iter().take(CANDIDATES).map(rounded).collect();
        Some(json!({ "time_s": tick.observation.time_s - playback.start_s(), "hands": hands }))
    };
    playback.ticks.iter().filter_map(of_tick).collect()
}

fn stages(playback: &Playback) -> Option<Value> {
    let times = playback.times.as_ref()?;
    let mut names: Vec<&String> = Vec::new();
    for (name, _) in times.ticks.iter().flat_map(|tick| &tick.stage_ms) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let row = |tick: &TickTimes| -> Vec<f64> {
        let of = |name: &&String| tick.stage_ms.iter().find(|(it, _)| it == *name).map_or(-1.0, |(_, ms)| *ms);
        names.iter().map(of).collect()
    };
    // Durations in milliseconds, per tick one number per name; −1 where the stage did not run.
    let ms: Vec<f64> = times.ticks.iter().flat_map(row).collect();
    let time_s: Vec<f64> = times.ticks.iter().map(|tick| tick.time_s - playback.start_s()).collect();
    Some(json!({ "names": names, "time_s": time_s, "ms": Packed::numbers(&ms, names.len().max(1)) }))
}
