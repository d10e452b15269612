//! Time of the finger contact.

use catch_bot::grasp_selection::Config;
use nalgebra::Vector3;

#[test]
fn fingers_touch_when_the_centre_of_the_object_passes() {
    let config = Config {
        finger_braking_distance_m: 0.0,
        palm_braking_distance_m: 0.0,
        palm_rebound_distance_m: 0.0,
        ..Config::default()
    };
    let (v_G, past_G) = (Vector3::new(0.3, 0.0, 3.0), Vector3::new(0.01, 0.0, 0.02));
    let lead_s = config.contact_lead_s(&v_G, &past_G);
    let distance = |before_s: f64| (past_G - v_G * before_s).xz().norm();
    assert!(distance(lead_s) < distance(lead_s - 1e-4) && distance(lead_s) < distance(lead_s + 1e-4));
    // An object that is held by its front cannot come as far as its centre.
    let toward_palm = Vector3::new(0.0, -4.0, 0.0);
    assert_eq!(config.contact_lead_s(&toward_palm, &Vector3::new(0.0, 0.03, 0.0)), 0.0);
}

#[test]
fn what_bounces_little_is_touched_on_its_way_back() {
    let config = |restitution: f64| Config {
        palm_braking_distance_m: 0.02,
        palm_rebound_distance_m: 0.025,
        restitution: Some(restitution),
        ..Config::default()
    };
    let toward_palm = Vector3::new(0.0, -4.0, 0.0);
    let travel_m = |restitution: f64| config(restitution).contact_lead_s(&toward_palm, &Vector3::zeros()) * 4.0;
    assert!((travel_m(1.0) - 0.02).abs() < 1e-12);
    assert!((travel_m(0.5) + 0.005).abs() < 1e-12);
    assert!((travel_m(0.3) + 0.115 / 3.0).abs() < 1e-12 && (travel_m(0.0) - travel_m(0.3)).abs() < 1e-12);
    // Across the fingers nothing comes back.
    let across = Vector3::new(0.0, 0.0, 4.0);
    assert_eq!(
        config(0.3).contact_lead_s(&across, &Vector3::zeros()),
        config(1.0).contact_lead_s(&across, &Vector3::zeros())
    );
}
