//! Joint velocities at the catch.

use catch_body::{JointVector, MAX_JOINTS, robot::Jacobian};
use catch_bot::trajectory_optimization::{
    reachability::Interval,
    terminal_velocity::{DAMPING, FOLLOWING, Weights, terminal_velocity},
};
use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;

#[test]
fn the_grasp_centre_moves_along_with_the_object() {
    let jacobian = jacobian();
    let v_WO = Vector3::new(-2.0, -3.0, -1.0);
    for width in [0.1, 0.5, 2.0] {
        let found = terminal_velocity(
            &jacobian,
            &v_WO,
            &[Interval { low: -width, high: width }; MAX_JOINTS],
            &Weights::BALANCED,
            None,
        )
        .unwrap();
        let moved = jacobian.fixed_rows::<3>(3) * found.dq;
        assert!((moved - v_WO * found.speed_fraction).norm() < 1e-10);
        assert!(found.dq.amax() <= width + 1e-12 && found.speed_fraction <= 0.3 + 1e-12);
    }
}

/// A Jacobian that no column of is like another.
fn jacobian() -> Jacobian {
    Jacobian::from_fn(|row, column| if column < 7 { ((row * 7 + column * 3) % 11) as f64 / 11.0 - 0.4 } else { 0.0 })
}

#[test]
fn a_hand_that_follows_leaves_no_velocity_across_its_approach() {
    let (jacobian, v_WO) = (jacobian(), Vector3::new(-2.0, -3.0, -1.0));
    let R_WG = Rotation3::from_euler_angles(0.3, -0.7, 1.1);
    let following = Some((R_WG, FOLLOWING * 1e3));
    let bounds = [Interval { low: -50.0, high: 50.0 }; MAX_JOINTS];
    let found = terminal_velocity(&jacobian, &v_WO, &bounds, &Weights::BALANCED, following.as_ref()).unwrap();
    assert!((jacobian.fixed_rows::<3>(3) * found.dq - found.v_WG).norm() < 1e-12);
    let left = R_WG.inverse() * (v_WO - found.v_WG);
    let expected = Vector3::new(0.0, 0.7 * (R_WG.inverse() * v_WO).y, 0.0);
    assert!((left - expected).norm() < 0.02, "{left}, not {expected}");
}

proptest! {
    /// No other velocities within the bounds cost less.
    #[test]
    fn following_is_optimal(
        angles in prop::array::uniform3(-3.0_f64..3.0),
        v in prop::array::uniform3(-4.0_f64..4.0),
        width in 0.1_f64..2.0,
        other in prop::array::uniform7(-1.0_f64..1.0),
    ) {
        let (jacobian, v_WO, R_WG) =
            (jacobian(), Vector3::from(v), Rotation3::from_euler_angles(angles[0], angles[1], angles[2]));
        let weights = Weights::BALANCED;
        let mut bounds = [Interval { low: 0.0, high: 0.0 }; MAX_JOINTS];
        bounds[..7].fill(Interval { low: -width, high: width });
        let found =
            terminal_velocity(&jacobian, &v_WO, &bounds, &weights, Some(&(R_WG, FOLLOWING))).unwrap();
        let cost = |dq: &JointVector| {
            let left = R_WG.inverse() * (jacobian.fixed_rows::<3>(3) * dq - v_WO);
            let along = left.y + 0.7 * (R_WG.inverse() * v_WO).y;
            FOLLOWING.x * left.x.powi(2)
                + FOLLOWING.y * along.powi(2)
                + FOLLOWING.z * left.z.powi(2)
                + weights.spin * (jacobian.fixed_rows::<3>(0) * dq).norm_squared()
                + DAMPING * dq.norm_squared()
        };
        let least = cost(&found.dq);
        prop_assert!(found.dq.amax() <= width + 1e-9);
        for step in [1.0, 0.1, 0.01] {
            let other = JointVector::from_fn(|i, _| other.get(i).map_or(0.0, |it| it * width));
            prop_assert!(cost(&(found.dq + (other - found.dq) * step)) >= least - 1e-9);
        }
    }
}
