"""Flights, poses and plans."""

from __future__ import annotations

import numpy as np

import catchingbot as cb


def test_a_flight_goes_on():
    t = np.arange(30) * 0.01
    p = np.stack([1 - 3 * t, 0.2 + 0 * t, 1 + 4 * t - 4.905 * t**2], axis=1)
    rng = np.random.default_rng(1)
    flight = cb.predict(t, p + rng.normal(0, 0.001, p.shape))
    assert np.allclose(flight.at(0.6), [1 - 1.8, 0.2, 1 + 2.4 - 4.905 * 0.36], atol=0.02)
    assert flight.at([0.5, 0.6]).shape == (2, 3) and np.array_equal(flight.at([0.5, 0.6])[1], flight.at(0.6))
    assert np.allclose(flight.velocity(0.6), [-3, 0, 4 - 9.81 * 0.6], atol=0.1)
    covariance = flight.covariance(0.6)
    assert covariance.shape == (6, 6) and np.linalg.eigvalsh(covariance).min() > 0
    y_up = cb.predict(t, p[:, [0, 2, 1]] * [1, 1, -1], up="y")
    assert np.allclose(y_up.at(0.6)[[0, 2, 1]] * [1, -1, 1], flight.at(0.6), atol=0.02)
    assert flight.inliers == 30 and abs(flight.drag_per_m) < 0.05


def test_a_flight_with_orientations_knows_its_aerodynamics():
    t = np.arange(30) * 0.01
    p = np.stack([1 - 3 * t, 0 * t, 1 + 4 * t - 4.905 * t**2], axis=1)
    q = np.stack([0 * t, 0 * t, np.sin(t), np.cos(t)], axis=1)
    flight = cb.predict(t, p, q)
    assert np.allclose(flight.at(0.5), [-0.5, 0, 3 - 4.905 * 0.25], atol=0.03)


def test_a_cloud_is_registered():
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    reference = directions * [0.02, 0.035, 0.06]
    angle = 0.4
    X_CR = np.array(
        [
            [np.cos(angle), -np.sin(angle), 0, 0.3],
            [np.sin(angle), np.cos(angle), 0, -0.1],
            [0, 0, 1, 0.8],
            [0, 0, 0, 1],
        ]
    )
    points = reference[::5] @ X_CR[:3, :3].T + X_CR[:3, 3]
    pose = cb.register(points, reference, noise_m=0.001)
    assert pose.status == "registered", pose
    assert np.linalg.norm(pose.X_CR[:3, 3] - X_CR[:3, 3]) < 0.003
    assert pose.information.shape == (6, 6) and pose.residual_m < 0.003
    assert pose.symmetry == "finite"
    named = cb.register(points, "banana")
    assert isinstance(named.status, str)


def test_a_catch_is_planned(setup):
    arena, brain = setup.arena(), setup.brain()
    while brain.flight is None:
        arena.act(brain.tick(arena.sense()))
    flight = brain.flight
    now_s = 0.1
    plan = setup.plan(setup.ready_q, 0 * setup.ready_q, flight, now_s)
    assert plan.status == "planned", plan
    assert plan.control_points.shape == (len(plan.knots_s) - 4, setup.dof)
    assert plan.knots_s[0] == now_s and plan.knots_s[0] < plan.catch_s < plan.knots_s[-1]
    assert np.allclose(plan.control_points[0], setup.ready_q)
    low, high = setup.limits[:2]
    assert np.all(plan.control_points > low) and np.all(plan.control_points < high)
    assert plan.X_WG.shape == (4, 4) and 0 < plan.aperture_m < 0.2 and plan.q.shape == (setup.dof,)
    # What is planned is what an arena takes.
    arena = setup.arena()
    arena.sense()
    arena.act(cb.Command(cb.Trajectory(1, plan.knots_s, plan.control_points)))
    while not arena.done:
        observation = arena.sense()
        assert observation.arm.rejected == []
        arena.act()
    assert arena.row["limit_violations"] == 0
    late = setup.plan(setup.ready_q, 0 * setup.ready_q, flight, 3.0)
    assert late.status != "planned" and late.knots_s is None and late.control_points is None
