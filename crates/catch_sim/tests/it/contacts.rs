//! Friction and restitution against theory, and that what is squeezed stays where it is.

use catch_body::Gripper;
use catch_cell::GripperMove;
use catch_sim::{
    GripperDriveKind, ThrownObject,
    gripper_drive::{DRIVE_MASS_KG, GripperDrive},
    physics::{World, WorldSettings},
    random_streams::{Draws, Stream},
};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::setting;

/// A hand fixed in the world that holds an object between its fingers.
struct Grip {
    world: World,
    drive: GripperDrive,
    steps: u32,
}

impl Grip {
    /// Squeezes `object`, which waits between the fingers, for 0.3 s without gravity.
    fn of(object: &ThrownObject, width_m: f64, friction: f64, force_n: f64) -> Self {
        Self::with_drive(object, width_m, setting::settings(friction, 0.0), force_n)
    }

    fn with_drive(object: &ThrownObject, width_m: f64, settings: WorldSettings, force_n: f64) -> Self {
        let gripper = setting::gripper();
        let p_WG = Point3::new(0.0, 0.0, 2.0);
        let mut release = setting::release([0.0, gripper.grasp_centre_y_m, 2.0], [0.0; 3]);
        // Round things have 32 flat strips: one of them faces each finger, so that nothing rolls from strip
        // to strip.
        release.q_WO = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI / 32.0);
        let world = setting::fixed_hand(settings, p_WG, &gripper, width_m, object, &release);
        let mut drive = match settings.drive_mass_kg {
            0.0 => setting::ideal_drive(&gripper, width_m),
            _ => {
                let mut prompt = gripper.clone();
                prompt.drive.latency_s = 0.0;
                GripperDrive::new(GripperDriveKind::Real, &prompt, width_m, &mut Draws::new(Stream::Gripper, 0, 0))
            }
        };
        drive.receive(&[GripperMove { start_s: 0.0, width_m: 0.0, speed_mps: 0.4, force_n }], 0.0);
        let mut grip = Self { world, drive, steps: 0 };
        grip.hold(0.3, &|_| (Vector3::zeros(), Vector3::zeros()));
        grip
    }

    /// Goes on holding; `load` gives the force on the object and gravity by the time since the call.
    fn hold(&mut self, duration_s: f64, load: &dyn Fn(f64) -> (Vector3<f64>, Vector3<f64>)) {
        for i in 0..(duration_s * 1e3).round() as u32 {
            let state = self.world.state();
            let mut loads = setting::no_loads();
            loads.finger_force_n = self.drive.forces(f64::from(self.steps) * 1e-3, state.finger_m, state.finger_mps);
            (loads.object_force_n, loads.gravity) = load(f64::from(i) * 1e-3);
            self.world.step(&loads);
            self.steps += 1;
        }
    }

    fn place(&self) -> Vector3<f64> {
        self.world.state().X_WO.translation.vector
    }
}

/// The pull at which a squeezed object begins to slide is 2·μ·N.
#[test]
fn squeezed_objects_slide_at_the_coulomb_limit() {
    for (name, width_m) in [("tennis_ball", 0.068), ("pill_bottle", 0.052)] {
        for friction in [0.4, 0.667, 1.0] {
            let object = setting::object(name);
            let mut grip = Grip::of(&object, width_m, friction, 40.0);
            let [left, right] = grip.world.contact_forces.finger_n;
            let limit = friction * (left + right);
            // Pulled along the fingers ever harder.
            let (pulling_s, fastest) = (1.0, 1.2);
            let start = grip.place();
            let mut slid_at = None;
            for step in 0..1000 {
                let fraction = f64::from(step) / 1000.0 * fastest;
                let pull = Vector3::new(0.0, fraction * limit, 0.0);
                grip.hold(pulling_s / 1000.0, &|_| (pull, Vector3::zeros()));
                let slipping = grip.world.state().V_WO.linear.norm() > 0.01 && (grip.place() - start).norm() > 1e-4;
                if slipping && slid_at.is_none() {
                    slid_at = Some(fraction);
                }
            }
            let fraction = slid_at.expect("it slides before 1.2 times the limit");
            assert!((fraction - 1.0).abs() < 0.05, "{name}, μ = {friction}: slides at {fraction} of the limit");
        }
    }
}

/// Both fingers press with the force that was asked for.
#[test]
fn fingers_press_as_hard_as_they_are_told() {
    for force_n in [20.0, 40.0, 60.0] {
        let grip = Grip::of(&setting::object("tennis_ball"), 0.068, 0.667, force_n);
        for measured in grip.world.contact_forces.finger_n {
            assert!((measured / force_n - 1.0).abs() < 1e-3, "{measured} N of {force_n} N");
        }
    }
}

/// A finger sinks into the ball by F/k and hardly into a bottle, whatever drives it. The bottle is bounded by
/// the highest frequency of contacts.
#[test]
#[expect(clippy::print_stdout, reason = "the figure of docs/reference/checks.md")]
fn what_is_squeezed_is_as_stiff_as_its_file_says() {
    for (name, width_m) in [("tennis_ball", 0.068), ("pill_bottle", 0.052)] {
        let object = setting::object(name);
        for drive_mass_kg in [0.0, DRIVE_MASS_KG] {
            let settings = WorldSettings { drive_mass_kg, ..setting::settings(0.667, 0.0) };
            let apart_m = |force_n: f64| {
                let grip = Grip::with_drive(&object, width_m, settings, force_n);
                grip.world.state().finger_m.iter().sum::<f64>()
            };
            // From a touch of 8 N to 80 N, on each side.
            let squeeze_m = (apart_m(8.0) - apart_m(80.0)) / 2.0 * 80.0 / 72.0;
            println!("{name}: {:.2} mm under 80 N with {drive_mass_kg} kg at each finger", squeeze_m * 1e3);
            match object.stiffness_npm {
                Some(stiffness_npm) => {
                    let ratio = squeeze_m / (80.0 / stiffness_npm);
                    assert!((ratio - 1.0).abs() < 0.15, "{name}, {drive_mass_kg} kg: {ratio} of F/k");
                }
                None => assert!((0.0..3e-4).contains(&squeeze_m), "{name}, {drive_mass_kg} kg: {squeeze_m} m"),
            }
        }
    }
}

/// A ball and a bottle are not held without friction. A banana of several convex parts is, and is left out.
#[test]
fn without_friction_everything_falls() {
    for (name, width_m) in [("tennis_ball", 0.068), ("pill_bottle", 0.052)] {
        let mut grip = Grip::of(&setting::object(name), width_m, 0.0, 72.0);
        let start = grip.place();
        grip.hold(0.4, &|_| (Vector3::zeros(), Vector3::new(0.0, 0.0, -9.81)));
        let fallen_m = start.z - grip.place().z;
        assert!(fallen_m > 0.3, "{name}: {fallen_m} m in 0.4 s");
    }
}

/// Shaken by ±10 m/s² on top of gravity, squeezed objects stay in place.
#[test]
fn shaken_objects_stay_in_the_grasp() {
    for (name, width_m, tolerated_m) in
        [("tennis_ball", 0.068, 2e-7), ("pill_bottle", 0.052, 2.5e-5), ("banana", 0.031, 2e-7)]
    {
        let mut grip = Grip::of(&setting::object(name), width_m, 0.667, 72.0);
        let gravity = Vector3::new(0.0, 0.0, -9.81);
        grip.hold(0.5, &|_| (Vector3::zeros(), gravity));
        let settled = grip.place();
        grip.hold(2.0, &|t| {
            let shake = 10.0 * libm::sin(std::f64::consts::TAU * 2.0 * t);
            (Vector3::zeros(), gravity + Vector3::repeat(shake / 3.0f64.sqrt()))
        });
        grip.hold(0.2, &|_| (Vector3::zeros(), gravity));
        let drift = (grip.place() - settled).norm();
        assert!(drift < tolerated_m, "{name}: {drift} m");
    }
}

/// Upside down and whichever way else it hangs, and pushed as hard again, a squeezed object stays; without
/// friction it does not.
#[test]
fn what_is_held_stays_whichever_way_the_hand_is_turned() {
    for (name, width_m) in [("tennis_ball", 0.068), ("pill_bottle", 0.052), ("banana", 0.031)] {
        let drift_m = |friction: f64| {
            let mut grip = Grip::of(&setting::object(name), width_m, friction, 72.0);
            let settled = grip.place();
            let mut farthest_m = 0.0f64;
            for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
                for down in [-axis, axis] {
                    grip.hold(0.3, &|_| (Vector3::zeros(), down * 2.0 * 9.81));
                    farthest_m = farthest_m.max((grip.place() - settled).norm());
                }
            }
            farthest_m
        };
        assert!(drift_m(0.667) < 1e-3, "{name}: {} m", drift_m(0.667));
        // The parts of a banana hold it even so.
        assert!(name == "banana" || drift_m(0.0) > 0.05, "{name} without friction: {} m", drift_m(0.0));
    }
}

/// A ball rebounds from the floor at e times its speed.
#[test]
fn restitution_is_exact() {
    for restitution in [0.3, 0.5, 0.75] {
        for speed in [1.0, 3.0, 6.0] {
            let gripper = setting::gripper();
            let settings = setting::settings(0.6, restitution);
            let ball = setting::object("tennis_ball");
            let release = setting::release([5.0, 5.0, 0.0336 + 0.05], [0.0, 0.0, -speed]);
            let hand = Point3::new(0.0, 0.0, 2.0);
            let mut world = setting::fixed_hand(settings, hand, &gripper, 0.1, &ball, &release);
            let mut loads = setting::no_loads();
            loads.gravity = Vector3::zeros();
            for _ in 0..200 {
                world.step(&loads);
            }
            let rebound = world.state().V_WO.linear.z / speed;
            assert!((rebound / restitution - 1.0).abs() < 0.02, "{rebound} instead of {restitution} at {speed} m/s");
        }
    }
}

/// A ball that slides through all of an impact loses μ·(1 + e)·v of its tangential speed; one that comes to
/// roll leaves as fast as its inertia says.
#[test]
fn friction_acts_during_the_rebound_too() {
    let ball = setting::object("tennis_ball");
    let (radius_m, speed) = (0.0336, 3.0);
    let rolling = 1.0 / (1.0 + ball.mass_kg * radius_m * radius_m / ball.inertia_kgm2[(0, 0)]);
    for (friction, restitution, along) in [(0.1, 0.5, 4.0), (0.3, 0.75, 6.0), (0.6, 0.3, 1.0), (0.6, 0.75, 2.0)] {
        let gripper = setting::gripper();
        let settings = setting::settings(friction, restitution);
        let release = setting::release([5.0, 5.0, radius_m + 0.02], [along, 0.0, -speed]);
        let hand = Point3::new(0.0, 0.0, 2.0);
        let mut world = setting::fixed_hand(settings, hand, &gripper, 0.1, &ball, &release);
        let mut loads = setting::no_loads();
        loads.gravity = Vector3::zeros();
        for _ in 0..40 {
            world.step(&loads);
        }
        let lost = along - world.state().V_WO.linear.x;
        let sliding = friction * (1.0 + restitution) * speed;
        let expected = sliding.min(along * rolling);
        assert!((lost / expected - 1.0).abs() < 0.03, "{lost} instead of {expected} m/s for μ = {friction}");
    }
}

/// Two fingers that close without a motor meet a ball at once: each rebounds at e times its speed, and the
/// ball stays where it is.
#[test]
#[expect(clippy::print_stdout, reason = "the figure of docs/reference/checks.md")]
fn restitution_of_a_ball_between_two_closing_fingers_is_exact() {
    let mut worst = 0.0f64;
    for restitution in [0.3, 0.5, 0.75] {
        for speed in [0.2, 0.6, 2.0] {
            let gripper = setting::gripper();
            let ball = setting::object("tennis_ball");
            let hand = Point3::new(0.0, 0.0, 2.0);
            let release = setting::release([0.0, gripper.grasp_centre_y_m, 2.0], [0.0; 3]);
            let settings = setting::settings(0.6, restitution);
            let mut world = setting::fixed_hand(settings, hand, &gripper, 0.1, &ball, &release);
            let mut loads = setting::no_loads();
            loads.gravity = Vector3::zeros();
            // One push, and then nothing but the ball in their way.
            loads.finger_force_n = [-gripper.finger_mass_kg * speed / 1e-3; 2];
            world.step(&loads);
            loads.finger_force_n = [0.0; 2];
            let closing = world.state().finger_mps;
            while world.contact_forces.finger_n == [0.0; 2] {
                world.step(&loads);
            }
            let state = world.state();
            let impulse_ns = gripper.finger_mass_kg * (state.finger_mps[0] - closing[0]);
            let told_ns = world.contact_forces.contact.peak_impulse_ns;
            assert!((told_ns / impulse_ns - 1.0).abs() < 1e-2, "{told_ns} instead of {impulse_ns} N·s");
            let by_force_ns = world.contact_forces.finger_n[0] * 1e-3;
            assert!((by_force_ns / impulse_ns - 1.0).abs() < 1e-2, "{by_force_ns} instead of {impulse_ns} N·s");
            for (after, before) in state.finger_mps.into_iter().zip(closing) {
                let rebound = -after / before;
                let error = (rebound / restitution - 1.0).abs();
                worst = worst.max(error);
                assert!(error < 1e-3, "{rebound} instead of {restitution} at {speed} m/s");
            }
            assert!(state.V_WO.linear.norm() < 1e-6 * speed, "{}", state.V_WO.linear);
        }
    }
    println!("restitution between two fingers off by {worst:.1e} at most");
}

/// The fingers of the ideal drive: about 5 ms from wide open to a tennis ball.
#[test]
fn ideal_fingers_reach_a_tennis_ball_in_five_milliseconds() {
    let gripper: Gripper = setting::gripper();
    let ball = setting::object("tennis_ball");
    let release = setting::release([5.0, 5.0, 5.0], [0.0; 3]);
    let hand = Point3::new(0.0, 0.0, 2.0);
    let mut world = setting::fixed_hand(setting::settings(0.6, 0.5), hand, &gripper, 0.11, &ball, &release);
    let mut drive = setting::ideal_drive(&gripper, 0.11);
    drive.receive(&[GripperMove { start_s: 0.0, width_m: 0.0, speed_mps: f64::INFINITY, force_n: 80.0 }], 0.0);
    let mut steps = 0u32;
    while world.state().finger_m.iter().sum::<f64>() > 0.0672 {
        let state = world.state();
        let mut loads = setting::no_loads();
        loads.finger_force_n = drive.forces(f64::from(steps) * 1e-3, state.finger_m, state.finger_mps);
        world.step(&loads);
        steps += 1;
    }
    assert!((5..=7).contains(&steps), "{steps} ms");
}
