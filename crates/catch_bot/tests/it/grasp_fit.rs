//! Fit of an object between the fingers.

use catch_body::{Gripper, Pose};
use catch_bot::{
    grasp_selection::{Config, GraspSet, KEPT, Sampling},
    perception::ReferenceModel,
};
use nalgebra::Point3;
use nalgebra::Vector3;

fn gripper() -> Gripper {
    Gripper::from_toml("wsg50.toml", include_str!("../../../../assets/grippers/wsg50.toml")).unwrap()
}

/// Points all over an ellipsoid.
fn ellipsoid(semi_axes: Vector3<f64>) -> ReferenceModel {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let mut model = ReferenceModel::default();
    for i in 0..3000 {
        let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / 3000.0;
        let (s, c) = libm::sincos(golden * f64::from(i));
        let r = (1.0 - z * z).sqrt();
        let unit = Vector3::new(r * c, r * s, z);
        model.points.push(Point3::from(unit.component_mul(&semi_axes)));
        model.normals.push(unit.component_div(&semi_axes).normalize());
    }
    model.radius_m = semi_axes.max();
    model
}

fn sample(sampling: &Sampling<'_>, reference: &ReferenceModel, gripper: &Gripper) -> GraspSet {
    GraspSet::sample_as(sampling, reference, gripper, &Config::default())
}

#[test]
fn a_ball_can_be_held_from_everywhere() {
    let sampling = Sampling { most: 50, turns_rad: &[], ..Sampling::DEFAULT };
    let set = sample(&sampling, &ellipsoid(Vector3::repeat(0.0335)), &gripper());
    assert_eq!(set.grasps.len(), 200);
    for grasp in &set.grasps {
        assert!((grasp.object_width_m - 0.067).abs() < 1e-3);
        assert!((grasp.X_OG * gripper().grasp_centre()).coords.norm() < 2e-3, "the ball is at the grasp centre");
    }
}

#[test]
fn a_long_body_is_held_across_and_a_wide_one_not_at_all() {
    let sampling = Sampling { most: 100, ..Sampling::DEFAULT };
    let set = sample(&sampling, &ellipsoid(Vector3::new(0.02, 0.03, 0.09)), &gripper());
    assert!(!set.grasps.is_empty());
    for grasp in &set.grasps {
        let closing = grasp.X_OG * Vector3::x();
        assert!(closing.z.abs() < 0.5, "never closes along the length");
        assert!(grasp.object_width_m < 0.062);
    }
    assert!(sample(&sampling, &ellipsoid(Vector3::repeat(0.06)), &gripper()).grasps.is_empty());
}

/// Few places on a large body can be held: more are tried there.
#[test]
fn sampling_ends_when_there_are_enough_grasps() {
    let sampling = Sampling { fewest: 10, enough: 300, turns_rad: &[], ..Sampling::DEFAULT };
    for semi_axes in [Vector3::repeat(0.0335), Vector3::new(0.02, 0.045, 0.085)] {
        let found = sample(&sampling, &ellipsoid(semi_axes), &gripper()).grasps.len();
        assert!((300..304).contains(&found), "{found} grasps");
    }
    let few = Sampling { most: 75, ..sampling };
    let found = sample(&few, &ellipsoid(Vector3::new(0.02, 0.045, 0.085)), &gripper()).grasps.len();
    assert!((1..300).contains(&found), "{found} grasps");
}

/// A body whose narrow side does not lie across its flight is held across the wide one.
#[test]
fn a_body_is_also_held_where_less_than_the_finger_margin_is_free() {
    let set = GraspSet::sample(&ellipsoid(Vector3::new(0.02, 0.045, 0.045)), &gripper(), &Config::default());
    let widest_m = gripper().max_width_m - 2.0 * Config::default().finger_margin_m;
    let wide = set.grasps.iter().filter(|it| it.object_width_m > widest_m);
    assert!(wide.clone().count() > 0 && wide.clone().count() < set.grasps.len());
    assert!(wide.into_iter().all(|it| it.aperture_m == gripper().max_width_m));
}

fn slow(control: &str) -> Gripper {
    let file = include_str!("../../../../assets/grippers/franka_hand.toml").replace("\"speed_and_force\"", control);
    Gripper::from_toml("slow.toml", &file).unwrap()
}

#[test]
fn an_object_too_wide_for_the_finger_margin_is_held_with_less() {
    let sampling = Sampling { most: 20, ..Sampling::DEFAULT };
    let set = sample(&sampling, &ellipsoid(Vector3::repeat(0.0335)), &slow("\"position\""));
    assert!(set.grasps.iter().all(|it| it.aperture_m == 0.08) && !set.grasps.is_empty());
    assert!(sample(&sampling, &ellipsoid(Vector3::repeat(0.038)), &slow("\"position\"")).grasps.is_empty());
}

#[test]
fn slow_fingers_wait_as_near_as_the_position_is_certain() {
    let config = Config::default();
    let margin_m = |control: &str, sd_m: f64| config.pre_closing_margin_m(&slow(control), || sd_m);
    assert_eq!([0.0, 2e-3, 1.0].map(|sd_m| margin_m("\"speed_and_force\"", sd_m)), [3e-3, 6e-3, 12e-3].map(Some));
    assert_eq!(config.pre_closing_margin_m(&gripper(), || 1e-3), None, "fast fingers");
    // A gripper that knows open and closed alone waits open.
    assert_eq!(margin_m("\"two_state\"", 1e-3), None);
    let set = GraspSet::sample(&ellipsoid(Vector3::repeat(0.02)), &slow("\"two_state\""), &config);
    assert!(set.grasps.iter().all(|it| it.aperture_m == 0.08) && !set.grasps.is_empty());
}

/// A body without symmetry of a ball gets grasps that come from elsewhere and close in the same direction.
#[test]
fn turned_grasps_close_in_the_same_direction() {
    let body = ellipsoid(Vector3::new(0.02, 0.02, 0.04));
    let sampling = Sampling { most: 1, turns_rad: &[0.5], ..Sampling::DEFAULT };
    let set = sample(&sampling, &body, &gripper());
    let plain = sample(&Sampling { turns_rad: &[], ..sampling }, &body, &gripper());
    assert!(set.grasps.len() > plain.grasps.len() && !plain.grasps.is_empty());
    for pair in set.grasps.windows(2) {
        let [one, two] = [&pair[0].X_OG, &pair[1].X_OG];
        if one.rotation.angle_to(&two.rotation) < 0.6 {
            assert!((one * Vector3::x()).dot(&(two * Vector3::x())) > 1.0 - 1e-9);
        }
    }
}

#[test]
fn only_what_may_be_reached_is_ranked() {
    let set = GraspSet::sample(&ellipsoid(Vector3::repeat(0.0335)), &gripper(), &Config::default());
    let rank = |may_reach: bool| {
        let config = Config::default();
        set.rank(&Pose::identity(), &Vector3::x(), &Point3::origin(), &config, |_| may_reach)
    };
    assert_eq!((rank(true).0.len(), rank(true).1), (KEPT, true));
    assert_eq!((rank(false).0.len(), rank(false).1), (0, true));
}
