//! Laws of mechanics through contacts: energy, momentum, and mirrored scenes.

use catch_body::{Gripper, Pose, Robot};
use catch_sim::{
    Release, ThrownObject,
    physics::{Loads, World, WorldSettings},
    random_streams::{Draws, Stream},
};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::setting;

/// A throw at the open gripper, from 0.4 m away, with a spin.
fn release_at(target: Point3<f64>, draws: &mut Draws) -> Release {
    let from = draws.direction().into_inner();
    let speed = draws.between([2.0, 6.0]);
    let aside = draws.direction().into_inner() * 0.06;
    Release {
        p_WO: target + from * 0.4 + aside,
        v_WO: -from * speed,
        q_WO: draws.orientation(),
        omega_WO: draws.direction().into_inner() * draws.between([0.0, 25.0]),
        path: None,
    }
}

fn no_gravity() -> Loads {
    Loads { gravity: Vector3::zeros(), ..setting::no_loads() }
}

/// A hand on an arm or fixed in the world, the drive of whose fingers has some mass.
struct Hand {
    robot: Robot,
    gripper: Gripper,
    drive_mass_kg: f64,
}

impl Hand {
    fn new(on_arm: bool, drive_mass_kg: f64) -> Self {
        let robot = if on_arm { setting::robot() } else { setting::fixed_mount(Point3::new(0.0, 0.0, 2.0)) };
        Self { robot, gripper: setting::gripper(), drive_mass_kg }
    }

    /// A throw at the hand.
    fn world(&self, settings: WorldSettings, object: &ThrownObject, draws: &mut Draws) -> World {
        let Self { robot, gripper, drive_mass_kg } = self;
        let q = &robot.ready_q;
        let release = release_at(robot.gripper_pose(q) * gripper.grasp_centre(), draws);
        let settings = WorldSettings { drive_mass_kg: *drive_mass_kg, ..settings };
        World::new(settings, (robot, q), gripper, 0.1, (object, &release))
    }

    /// Kinetic energy of everything that moves, rotors and the gripper's drive included, in J: of the arm
    /// with the fingers where they are, and what their motion adds.
    fn energy_j(&self, world: &World, object: &ThrownObject) -> f64 {
        let state = world.state();
        let mut robot = self.robot.clone();
        let V_WG = robot.gripper_twist(&state.q, &state.dq);
        let R_WG = robot.gripper_pose(&state.q).rotation;
        let mut fingers_j = 0.0;
        let mut inertia_G = self.gripper.body_inertia();
        for (i, (finger, opens)) in self.gripper.finger_inertias(0.0).into_iter().zip([-1.0, 1.0]).enumerate() {
            let finger_G = finger.transformed(&Pose::translation(opens * state.finger_m[i], 0.0, 0.0));
            inertia_G = inertia_G.joined(&finger_G);
            let rate = state.finger_mps[i];
            let along = R_WG * Vector3::new(opens, 0.0, 0.0);
            fingers_j += finger_G.mass * V_WG.velocity_at(&(R_WG * finger_G.com.coords)).dot(&along) * rate
                + (finger_G.mass + self.drive_mass_kg) * rate * rate / 2.0;
        }
        if let Some(last) = robot.joints.last_mut() {
            last.inertia = last.inertia.joined(&inertia_G.transformed(&robot.X_LG));
        }
        let arm_j = (robot.mass_matrix(&state.q) * state.dq).dot(&state.dq) / 2.0;
        let linear_j = object.mass_kg * state.V_WO.linear.norm_squared() / 2.0;
        let omega_O = state.X_WO.rotation.inverse() * state.V_WO.angular;
        arm_j + fingers_j + linear_j + (object.inertia_kgm2 * omega_O).dot(&omega_O) / 2.0
    }
}

/// Without motors no contact gives energy, for any restitution up to the errors of integration. Throws that
/// begin in contact do not count, nor what is faster than 50 rad/s: an impact uses the inertia of its start,
/// and such an object turns by a hundredth meanwhile.
#[test]
#[expect(clippy::print_stdout, reason = "the figure of docs/reference/checks.md")]
fn no_contact_gives_energy() {
    let mut touching = 0;
    let mut worst = [0.0f64; 2];
    for (seed, index) in (7..11).flat_map(|seed| (0..240).map(move |index| (seed, index))) {
        let mut draws = Draws::new(Stream::Throw, seed, index);
        let name = ["tennis_ball", "pill_bottle", "banana"][(index % 3) as usize];
        let restitution = [0.3, 0.75, 1.0, 1.0][(index / 3 % 4) as usize];
        let friction = [0.0, 0.667][(index / 12 % 2) as usize];
        let drive_mass_kg = [0.0, 0.5][(index / 24 % 2) as usize];
        let object = setting::object(name);
        let hand = Hand::new(index / 48 % 2 == 0, drive_mass_kg);
        let mut world = hand.world(setting::settings(friction, restitution), &object, &mut draws);
        let first_j = hand.energy_j(&world, &object);
        let (mut lowest_j, mut has_touched) = (first_j, false);
        for step in 0..300 {
            world.step(&no_gravity());
            let now_j = hand.energy_j(&world, &object);
            has_touched |= world.contact_forces.contact.any();
            if (has_touched && step < 5) || world.state().V_WO.angular.norm() > 50.0 {
                break;
            }
            let worst = &mut worst[usize::from(restitution == 1.0)];
            *worst = worst.max((now_j - lowest_j) / first_j);
            lowest_j = lowest_j.min(now_j);
        }
        touching += u32::from(has_touched);
    }
    let [below, at_one] = worst;
    println!("energy rises by {below:.1e} at most for a restitution up to 0.75, by {at_one:.1e} for 1");
    assert!(touching > 600, "{touching} of 960 met the hand");
    assert!(below < 1e-3 && at_one < 1e-2, "{below}, {at_one}");
}

/// The change of the momentum across the fingers is the sum of their counted forces, in each step of a
/// contact; so is that of a finger.
#[test]
fn forces_of_fingers_are_all_that_the_object_feels_across_them() {
    let gripper = setting::gripper();
    let (mut double, mut worst) = (0, 0.0f64);
    for index in 0..60 {
        let mut draws = Draws::new(Stream::Throw, 8, index);
        let name = ["tennis_ball", "pill_bottle"][(index % 2) as usize];
        let object = setting::object(name);
        let settings = setting::settings([0.0, 0.667][(index / 2 % 2) as usize], 0.6);
        let p_WG = Point3::new(0.0, 0.0, 2.0);
        let width_m = if name == "tennis_ball" { 0.0674 } else { 0.0512 };
        let mut release = setting::release([0.0, gripper.grasp_centre_y_m, 2.0], [0.0; 3]);
        release.v_WO =
            Vector3::new(draws.between([-0.05, 0.05]), draws.between([-0.3, 0.3]), draws.between([-0.3, 0.3]));
        release.q_WO = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI / 32.0);
        let mut world = setting::fixed_hand(settings, p_WG, &gripper, width_m, &object, &release);
        let mut loads = no_gravity();
        loads.finger_force_n = [-gripper.finger_mass_kg * draws.between([0.3, 2.0]) / 1e-3; 2];
        for _ in 0..30 {
            let before = world.state();
            world.step(&loads);
            let (after, forces) = (world.state(), world.contact_forces);
            let pushed_ns = loads.finger_force_n.map(|force_n| force_n * 1e-3);
            loads.finger_force_n = [0.0; 2];
            let contact = forces.contact;
            if !contact.left_finger && !contact.right_finger {
                continue;
            }
            double += u32::from(contact.left_finger && contact.right_finger);
            let counted_ns = forces.finger_n.map(|force_n| force_n * 1e-3);
            let gained_ns = object.mass_kg * (after.V_WO.linear.x - before.V_WO.linear.x);
            let of_fingers_ns: [f64; 2] = std::array::from_fn(|i| {
                gripper.finger_mass_kg * (after.finger_mps[i] - before.finger_mps[i]) - pushed_ns[i]
            });
            let largest_ns = contact.peak_impulse_ns.max(1e-3);
            worst = worst.max((counted_ns[0] - counted_ns[1] - gained_ns).abs() / largest_ns);
            for (counted_ns, of_finger_ns) in counted_ns.into_iter().zip(of_fingers_ns) {
                worst = worst.max((counted_ns - of_finger_ns).abs() / largest_ns);
            }
        }
    }
    assert!(double > 60, "{double} steps with both fingers");
    assert!(worst < 1e-4, "{worst} of the largest impulse");
}

/// An object thrown in the mirror image moves as in a mirror, through contacts too: a ball exactly, and a
/// bottle, which is met at several points one after the other, within 1 mm 20 ms later.
#[test]
fn a_mirrored_throw_goes_a_mirrored_way() {
    let gripper = setting::gripper();
    let p_WG = Point3::new(0.0, 0.0, 2.0);
    let mirrored = |v: &Vector3<f64>| Vector3::new(-v.x, v.y, v.z);
    // An axis of rotation is a pseudovector.
    let mirrored_axis = |v: &Vector3<f64>| Vector3::new(v.x, -v.y, -v.z);
    let (mut touching, mut farthest_m) = (0, [0.0f64; 2]);
    for index in 0..24 {
        let name = ["tennis_ball", "pill_bottle"][(index % 2) as usize];
        let object = setting::object(name);
        let mut draws = Draws::new(Stream::Throw, 9, index);
        let one = release_at(p_WG + Vector3::y() * gripper.grasp_centre_y_m, &mut draws);
        let other = Release {
            p_WO: mirrored(&one.p_WO.coords).into(),
            v_WO: mirrored(&one.v_WO),
            q_WO: UnitQuaternion::from_scaled_axis(mirrored_axis(&one.q_WO.scaled_axis())),
            omega_WO: mirrored_axis(&one.omega_WO),
            path: None,
        };
        let new = |release: &Release| {
            setting::fixed_hand(setting::settings(0.667, 0.5), p_WG, &gripper, 0.1, &object, release)
        };
        let (mut one, mut other) = (new(&one), new(&other));
        let mut since_contact = 0;
        for _ in 0..400 {
            one.step(&setting::no_loads());
            other.step(&setting::no_loads());
            since_contact += u32::from(since_contact > 0 || one.contact_forces.contact.any());
            if since_contact == 20 {
                break;
            }
        }
        touching += u32::from(since_contact == 20);
        let (one, other) = (one.state().X_WO.translation.vector, other.state().X_WO.translation.vector);
        let farthest_m = &mut farthest_m[(index % 2) as usize];
        *farthest_m = farthest_m.max((mirrored(&one) - other).norm());
    }
    assert!(touching > 12, "{touching} met the hand");
    let [ball_m, bottle_m] = farthest_m;
    assert!(ball_m < 1e-9 && bottle_m < 1e-3, "{ball_m} m and {bottle_m} m 20 ms after the first contact");
}
