//! No setting is dead: with another allowed value of each something comes out otherwise.

use std::{collections::BTreeMap, fmt::Write as _, fs, io, thread};

use catch_body::JointVector;
use catch_cell::{ArmTrajectory, BSpline, Cell, Command, DepthFrame, GripperMove, PixelWindow, TrajectoryId};
use catch_lab::{
    scenario::setup::{Choice, Setup},
    trial,
};

use crate::source::root;

/// Scenario in which a setting matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Where {
    /// A throw of the scenario honest: commands of the brain and true states.
    Honest,
    /// One of the paper's throws.
    Paper,
    /// One of the paper's throws, by the paper's method as published.
    AsPublished,
    /// The world alone, with commands that are always the same.
    World,
    /// The poses of the cameras after a calibration.
    Calibrated,
}
use Where::{AsPublished, Calibrated, Honest, Paper, World};

/// Settings: the scenario in which each matters, settings that it needs to matter, and another value of it.
const ALL: &[(Where, &[&str], &str)] = &[
    (Honest, &[], "limit_scale.velocity=0.5"),
    (Honest, &[], "limit_scale.acceleration=0.5"),
    (Paper, &["robot=panda"], "limit_scale.jerk=0.5"),
    (Honest, &[], "clock={ fixed_ms = 30 }"),
    (Calibrated, &[], "calibration.position_sd_m=0.02"),
    (Calibrated, &[], "calibration.rotation_sd_deg=1.0"),
    (Calibrated, &[], "calibration.poses=4"),
    (World, &[], "arena.gripper=position"),
    (Paper, &[], "arena.gripper_trigger=proximity"),
    (World, &[], "arena.published_bodies=true"),
    (World, &[], "arena.published_gripper=true"),
    (World, &[], "arena.friction=0.3"),
    (World, &[], "arena.friction={ min = 0.3, max = 0.5 }"),
    (World, &[], "arena.restitution_scale=0.5"),
    (World, &[], "arena.restitution_spread=0.3"),
    (World, &[], "arena.drag=true"),
    (World, &["arena.drag=true"], "arena.drag_spread=0.3"),
    (World, &["arena.drag=true"], "arena.wind=[3.0, 0.0, 0.0]"),
    (World, &[], "arena.max_spin_radps=20"),
    (World, &[], "arena.labels=false"),
    (World, &[], "arena.floor_visible=true"),
    (World, &[], "arena.frame_rate_hz=50"),
    (World, &["arena.frame_rate_hz=50"], "arena.free_running_cameras=true"),
    (World, &[], "arena.latency_s=0.02"),
    (World, &[], "arena.step_s=0.0005"),
    (World, &[], "arena.camera_faults=[{ camera = 1, kind = \"blinded\", from_s = 0.02 }]"),
    (World, &[], "arena.camera_faults=[{ camera = 1, kind = \"frozen\" }]"),
    (World, &[], "arena.camera_faults=[{ camera = 1, kind = \"silent\" }]"),
    (World, &[], "arena.camera_faults=[{ camera = 1, kind = { swapped = { with = 2 } } }]"),
    (World, &[], "arena.camera_faults=[{ camera = 1, kind = { pushed = { by_m = [0.1, 0.0, 0.0] } } }]"),
    (World, NEAR_PERSON, "arena.person.nearest_m=1.0"),
    (World, NEAR_PERSON, "arena.person.speed_mps=2.0"),
    (World, &[], "arena.thrower=true"),
    (World, &[], "room=office"),
    (World, BANANA_IN_AIR, "arena.aerodynamics.drag_anisotropy=0.8"),
    (World, BANANA_IN_AIR, "arena.aerodynamics.max_magnus=0.01"),
    (World, BANANA_IN_AIR, "arena.aerodynamics.max_spin_decay_per_s=1.0"),
    (World, &[], "arena.robot_errors.encoder_sd_rad=0.001"),
    (World, &[], "arena.robot_errors.encoder_step_rad=0.001"),
    (World, &[], "arena.robot_errors.link_mass_spread=0.1"),
    (World, &[], "arena.robot_errors.link_surface_sd_m=0.01"),
    (World, &[], "arena.robot_errors.tool_position_m=0.01"),
    (World, &[], "arena.robot_errors.tool_rotation_deg=1.0"),
    (World, &[], "arena.robot_controller.inexact=true"),
    (World, &[], "arena.robot_controller.takes_jumps=true"),
    (World, &["arena.robot_controller.takes_jumps=true"], "arena.robot_controller.unlimited_torque=true"),
    (World, &[], "arena.robot_controller.gains.proportional_per_s2=300"),
    (World, &[], "arena.robot_controller.gains.integral_per_s3=100"),
    (World, &[], "arena.robot_controller.gains.derivative_per_s=20"),
    (World, &[], LINKS),
    (World, &[], "arena.depth.model={ gaussian = { sd_m = 0.01 } }"),
    (World, STEREO, "arena.depth.model.stereo.baseline_m=0.2"),
    (World, STEREO, "arena.depth.model.stereo.subpixel_px=0.5"),
    (World, STEREO, "arena.depth.model.stereo.common_fraction=0.5"),
    (World, STEREO, "arena.depth.model.stereo.dropout_fraction=0.5"),
    (World, STEREO, "arena.depth.model.stereo.grazing_rad=[0.1, 0.5]"),
    (World, EDGES, "arena.depth.model.stereo.edge_px=3"),
    (World, EDGES, "arena.depth.model.stereo.bleed_fraction=0.6"),
    (World, EDGES, "arena.depth.model.stereo.flying_fraction=0.6"),
    (World, STEREO, "arena.depth.model.stereo.range_m=[0.2, 5.0]"),
    (World, &[], "arena.depth.lost_frame_fraction=0.3"),
    (World, &["arena.depth.lost_frame_fraction=0.3"], "arena.depth.lost_frame_persistence=0.9"),
    (World, &[], "arena.depth.hole_fraction=0.5"),
    (World, &[], "arena.depth.step_m=0.01"),
    (World, &[], "arena.depth.calibration_sd_m=0.01"),
    (World, &[], "arena.depth.calibration_sd_rad=0.01"),
    (World, &[], "arena.depth.pixel_shift_px=0.5"),
    (Honest, &[], "brain.method=paper"),
    (Honest, &[], "brain.pose_estimation=paper"),
    (Honest, &[], "brain.flight_prediction=paper"),
    (Honest, &[], "brain.perception.depth_noise={ constant_m = 0.3, quadratic_per_m = 0.01 }"),
    (Honest, NOISY, "brain.perception.depth_noise.constant_m=0.03"),
    (Honest, NOISY, "brain.perception.depth_noise.quadratic_per_m=0.004"),
    (Honest, &[], "brain.perception.camera_sd_rad=0.01"),
    (Honest, &[], "brain.perception.floor_visible=true"),
    (Honest, &[], "brain.perception.uncalibrated_cameras=[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]"),
    (Honest, &["room=office"], "brain.perception.background_images=3"),
    (Honest, &[], "brain.trajectory_prediction.drag_prior_per_m=0.1"),
    (Honest, &[], "brain.trajectory_prediction.drag_prior_sd_per_m=0.1"),
    (Honest, &[], "brain.trajectory_prediction.spin_prior_sd_radps=1.0"),
    (Honest, &[], "brain.trajectory_prediction.systematic_sd_m=0.02"),
    (Honest, &[], "brain.trajectory_prediction.com_sd_m=0.01"),
    (Honest, &[], "brain.trajectory_prediction.aerodynamics.drag_deviation_sd_per_m=0.02"),
    (Honest, &[], "brain.trajectory_prediction.aerodynamics.magnus=0.01"),
    (Honest, &[], "brain.trajectory_prediction.aerodynamics.magnus_sd=0.01"),
    (Honest, &[], "brain.trajectory_prediction.aerodynamics.lift_sd_radps=0.1"),
    (Honest, &[], "brain.trajectory_prediction.aerodynamics.spin_decay_per_s=1.0"),
    (Honest, &[], "brain.trajectory_prediction.aerodynamics.spin_decay_sd_per_s=1.0"),
    (Honest, &[], "brain.trajectory_prediction.process_noise.acceleration=0.1"),
    (Honest, &[], "brain.trajectory_prediction.process_noise.angular_acceleration=1.0"),
    (Honest, &[], "brain.grasp_selection.max_overhang_m=0.002"),
    (Honest, &[], "brain.grasp_selection.finger_margin_m=0.006"),
    (Honest, &[], "brain.grasp_selection.approach_margin_m=0.01"),
    (Honest, &[], "brain.grasp_selection.closing_speed_mps=0.2"),
    (Honest, &[], "brain.grasp_selection.closing_acceleration_mps2=2.0"),
    (Honest, &[], "brain.grasp_selection.finger_braking_distance_m=0.03"),
    (Honest, &[], "brain.grasp_selection.palm_braking_distance_m=0.0"),
    (Honest, &[], "brain.grasp_selection.palm_rebound_distance_m=0.0"),
    (Honest, &[], "brain.grasp_selection.restitution=0.9"),
    (Honest, &[], "brain.grasp_selection.weights.catchability=0.0"),
    (Honest, &[], "brain.grasp_selection.weights.strength=50.0"),
    (Honest, BOTTLE, "brain.grasp_selection.weights.overhang=0.0"),
    (Honest, &[], "brain.grasp_selection.weights.width=10000.0"),
    (Honest, &[], "brain.grasp_selection.weights.pass_through=60.0"),
    (Honest, &[], "brain.grasp_selection.weights.max_sideways=0.02"),
    (Honest, &[], "brain.grasp_selection.weights.max_from_behind=-1.0"),
    (Honest, &[], "brain.trajectory_optimization.terminal_velocity_scaling=0.2"),
    (Honest, &[], "brain.trajectory_optimization.object_mass_kg=2.0"),
    (Honest, &[], "brain.trajectory_optimization.clearance_m=0.2"),
    (Honest, &[], "brain.trajectory_optimization.weights.speed=20.0"),
    (Honest, &[], "brain.trajectory_optimization.weights.spin=20.0"),
    (Honest, &[], "brain.control.expected_latency_s=0.03"),
    (Honest, &[], "brain.control.gripper_latency_s=0.1"),
    (Honest, &[], "brain.control.closing_force_n=20.0"),
    (Honest, &[], "brain.control.switching_hysteresis=0.0"),
    (AsPublished, &[], "brain.paper_method.registration.as_published=false"),
    (AsPublished, &[], "brain.paper_method.prediction.ties_by_sum=false"),
    (AsPublished, &["object=pill_bottle"], "brain.paper_method.prediction.knows_symmetry=true"),
    (AsPublished, &[], "brain.paper_method.grasp.estimates_normals=false"),
    (AsPublished, &[], "brain.paper_method.motion.loose_pre_grasp=false"),
    (AsPublished, &[], "brain.paper_method.motion.loose_time=false"),
    (AsPublished, &[], "brain.paper_method.motion.starts_anywhere=false"),
    (AsPublished, &[], "brain.paper_method.motion.goes_on=false"),
    (AsPublished, &[], "brain.paper_method.motion.unchecked=false"),
    (AsPublished, &[], "brain.paper_method.motion.keeps_unsolved=false"),
    (AsPublished, &[], "brain.paper_method.motion.freezes_orientation=false"),
    (AsPublished, &[], "brain.paper_method.motion.confuses_wrist=false"),
];

const CALIBRATION: &[&str] =
    &["flight_rig=d435_1", "calibration={ position_sd_m = 0.005, rotation_sd_deg = 0.3, poses = 3 }"];
const NEAR_PERSON: &[&str] = &["arena.person={ nearest_m = 2.0, speed_mps = 1.0 }"];
const BANANA_IN_AIR: &[&str] = &["object=banana", "arena.drag=true", "arena.max_spin_radps=20"];
const STEREO: &[&str] = &["arena.depth.model={ stereo = {} }"];
const EDGES: &[&str] = &["arena.depth.model={ stereo = { edge_px = 2, bleed_fraction = 0.3, flying_fraction = 0.3 } }"];
/// A throw of a bottle that has grasps with the centre of mass far from the palm.
const BOTTLE: &[&str] = &["object=pill_bottle", "index=1"];
const NOISY: &[&str] = &["brain.perception.depth_noise={ constant_m = 0.002, quadratic_per_m = 0.001 }"];
/// Seven links of one kilogram.
const LINKS: &str = "arena.robot_controller.links=[{ mass_kg = 1.0, com_m = [0.0, 0.0, 0.1], inertia_kgm2 = [0.01, 0.01, 0.01], \
                     rotor_inertia_kgm2 = 0.1 }, { mass_kg = 1.0, com_m = [0.0, 0.0, 0.1], inertia_kgm2 = [0.01, 0.01, 0.01], \
                     rotor_inertia_kgm2 = 0.1 }, { mass_kg = 1.0, com_m = [0.0, 0.0, 0.1], inertia_kgm2 = [0.01, 0.01, 0.01], \
                     rotor_inertia_kgm2 = 0.1 }, { mass_kg = 1.0, com_m = [0.0, 0.0, 0.1], inertia_kgm2 = [0.01, 0.01, 0.01], \
                     rotor_inertia_kgm2 = 0.1 }, { mass_kg = 1.0, com_m = [0.0, 0.0, 0.1], inertia_kgm2 = [0.01, 0.01, 0.01], \
                     rotor_inertia_kgm2 = 0.1 }, { mass_kg = 1.0, com_m = [0.0, 0.0, 0.1], inertia_kgm2 = [0.01, 0.01, 0.01], \
                     rotor_inertia_kgm2 = 0.1 }, { mass_kg = 1.0, com_m = [0.0, 0.0, 0.1], inertia_kgm2 = [0.01, 0.01, 0.01], \
                     rotor_inertia_kgm2 = 0.1 }]";

/// Longer than until any catch, in seconds.
const AFTER_CATCH_S: f64 = 0.9;
/// Ticks of the world alone.
const TICKS: usize = 12;
const SEED: u64 = 5;

impl Where {
    fn setup(self, settings: &[&str]) -> Setup {
        let (scenario, object, throw) = match self {
            Honest => ("honest", "banana", None),
            Paper | World => ("paper", "tennis_ball", Some("near_sampled")),
            AsPublished => ("as-published", "banana", Some("near")),
            Calibrated => ("paper", "tennis_ball", None),
        };
        let object = settings.iter().find_map(|it| it.strip_prefix("object=")).unwrap_or(object);
        let robot = settings.iter().find_map(|it| it.strip_prefix("robot="));
        let is_choice = |it: &&&str| ["object=", "robot=", "index="].iter().any(|name| it.starts_with(name));
        let own: &[&str] = if self == Calibrated { CALIBRATION } else { &[] };
        let settings: Vec<String> =
            own.iter().chain(settings).filter(|it| !is_choice(it)).map(|&it| it.to_owned()).collect();
        let choice = Choice {
            scenario: Some(scenario),
            object: Some(object),
            robot,
            throw,
            settings: &settings,
            ..Choice::default()
        };
        Setup::load(&choice).unwrap_or_else(|fault| panic!("{settings:?}: {fault}"))
    }

    /// All that comes out.
    fn outcome(self, settings: &[&str]) -> String {
        let setup = self.setup(settings);
        let index = settings.iter().find_map(|it| it.strip_prefix("index=")).map_or(0, |it| it.parse().unwrap());
        let mut out = String::new();
        match self {
            World => {
                let mut arena = setup.arena(SEED, 0);
                for tick in 0..TICKS {
                    let Ok(observation) = arena.sense();
                    let _ = write!(out, "{} {:?} {:?}", observation.time_s, observation.arm, observation.gripper);
                    for frame in &observation.frames {
                        let _ = write!(out, "{} {} {}", frame.camera, frame.capture_s, hash(frame));
                    }
                    let Ok(()) = arena.act(&command(tick, &setup, observation.time_s));
                }
                let _ = write!(out, "{:?}", arena.truth());
            }
            Calibrated => {
                let _ = write!(out, "{:?}", setup.known_for(SEED).cameras);
            }
            Honest | Paper | AsPublished => {
                let ends_s = if self == Paper { f64::INFINITY } else { AFTER_CATCH_S };
                let trial = trial::run(&setup, SEED, index, &mut |tick, _| {
                    let _ = write!(out, "{:?}{:?}", tick.command, tick.report.map(|it| &it.flight));
                    if tick.observation.time_s < ends_s { Ok(()) } else { Err(io::Error::other("over")) }
                });
                if let Ok(trial) = trial {
                    let _ = write!(out, "{:?}", trial.truth);
                }
            }
        }
        out
    }
}

/// Hash of the depths and the mask of an image.
fn hash(frame: &DepthFrame) -> u64 {
    let depths = frame.depth_m.iter().map(|it| u64::from(it.to_bits()));
    let masked = frame.mask.iter().flatten().map(|it| u64::from(*it));
    let add = |sum: u64, it: u64| (sum ^ it).wrapping_mul(0x0100_0000_01b3);
    depths.chain(masked).chain([u64::from(frame.mask.is_some())]).fold(0xcbf2_9ce4_8422_2325, add)
}

/// Command of a tick: at first a jump of a joint, closing fingers and smaller images, later a motion from
/// rest to rest.
fn command(tick: usize, setup: &Setup, now_s: f64) -> Command {
    let ready_q = setup.robot.ready_q;
    let spline = match tick {
        0 => BSpline::at_rest(now_s, ready_q + JointVector::ith(0, 0.2)),
        3 => {
            let to = ready_q + JointVector::ith(1, 0.02);
            let knots_s = [0.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 0.3, 0.3, 0.3].map(|it| now_s + it).to_vec();
            BSpline { knots_s, control_points: vec![ready_q, ready_q, ready_q, to, to, to] }
        }
        _ => return Command::default(),
    };
    let arm = Some(ArmTrajectory { id: TrajectoryId(tick as u64 + 1), spline });
    let closing = GripperMove { start_s: now_s, width_m: 0.0, speed_mps: 0.4, force_n: 40.0 };
    let windows = vec![PixelWindow { left: 100, top: 75, width: 200, height: 150 }; setup.cameras.len()];
    Command { arm, gripper: (tick == 0).then(|| vec![closing]), windows: Some(windows) }
}

#[test]
fn another_value_of_each_setting_changes_something() {
    let bases: BTreeMap<(Where, &[&str]), String> = thread::scope(|scope| {
        let needed: std::collections::BTreeSet<_> = ALL.iter().map(|(at, with, _)| (*at, *with)).collect();
        let run = |(at, with): (Where, &'static [&'static str])| ((at, with), at.outcome(with));
        let (even, odd): (Vec<_>, Vec<_>) = needed.into_iter().enumerate().partition(|(i, _)| i % 2 == 0);
        let halves =
            [even, odd].map(|half| scope.spawn(move || half.into_iter().map(|(_, it)| run(it)).collect::<Vec<_>>()));
        halves.into_iter().flat_map(|it| it.join().unwrap()).collect()
    });
    let dead: Vec<&str> = thread::scope(|scope| {
        let bases = &bases;
        let halves = [0, 1].map(|half| {
            scope.spawn(move || {
                let mine = ALL.iter().skip(half).step_by(2);
                let is_dead = |(at, with, setting): &&(Where, &'static [&'static str], &'static str)| {
                    at.outcome(&[*with, &[*setting]].concat()) == bases[&(*at, *with)]
                };
                mine.filter(is_dead).map(|it| it.2).collect::<Vec<_>>()
            })
        });
        halves.into_iter().flat_map(|it| it.join().unwrap()).collect()
    });
    assert!(dead.is_empty(), "settings that change nothing: {dead:#?}");
}

/// The settings that the page of settings shows and that are neither names of files nor shown to matter
/// otherwise.
#[test]
fn each_setting_stands_in_the_table() {
    let page = fs::read_to_string(root().join("docs/reference/scenario.md")).unwrap();
    let mut missing = Vec::new();
    for section in page.split("\n## ").skip(1) {
        let (heading, rows) = section.split_once('\n').unwrap();
        if heading == "The file" || heading == "clock" || heading == "Numbers that are drawn" {
            continue;
        }
        let heading = heading.split(", kind").next().unwrap();
        for row in rows.lines().filter(|it| it.starts_with("| `") && !it.contains("](#")) {
            let name = row.trim_start_matches("| `").split('`').next().unwrap();
            let path = format!("{heading}.{name}");
            let is_word = |it: char| it.is_alphanumeric() || it == '_';
            let is_shown = ALL.iter().any(|(_, _, setting)| {
                let (of, value) = setting.split_once('=').unwrap();
                of == path || path.starts_with(of) && value.split(|it| !is_word(it)).any(|word| word == name)
            });
            if !is_shown && path != "arena.depth.model.perfect" {
                missing.push(path);
            }
        }
    }
    assert!(missing.is_empty(), "{missing:#?}");
}
