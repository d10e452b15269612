//! Joint velocities at the catch.

use catch_body::{MAX_JOINTS, robot::Jacobian};
use catch_bot::trajectory_optimization::{
    reachability::Interval,
    terminal_velocity::{Weights, terminal_velocity},
};
use nalgebra::Vector3;

#[test]
fn the_grasp_centre_moves_along_with_the_object() {
    let jacobian = Jacobian::from_fn(
        |row, column| if column < 7 { ((row * 7 + column * 3) % 11) as f64 / 11.0 - 0.4 } else { 0.0 },
    );
    let v_WO = Vector3::new(-2.0, -3.0, -1.0);
    for width in [0.1, 0.5, 2.0] {
        let found = terminal_velocity(
            &jacobian,
            &v_WO,
            &[Interval { low: -width, high: width }; MAX_JOINTS],
            0.3,
            &Weights::BALANCED,
        )
        .unwrap();
        let moved = jacobian.fixed_rows::<3>(3) * found.dq;
        assert!((moved - v_WO * found.speed_fraction).norm() < 1e-10);
        assert!(found.dq.amax() <= width + 1e-12 && found.speed_fraction <= 0.3 + 1e-12);
    }
}
