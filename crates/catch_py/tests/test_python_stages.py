"""Flight predictors and catch planners that are written in Python."""

from __future__ import annotations

import numpy as np
import pytest

import catchingbot as cb

GRAVITY = np.array([0.0, 0.0, -9.81])


class Parabola:
    """A parabola through all positions, by least squares."""

    def __init__(self, setup: cb.Setup, seed: int, index: int) -> None:
        self.least = 5

    def predict(self, poses: list[cb.ObjectPose], previous: cb.Flight | None) -> cb.Flight | None:
        assert previous is None or isinstance(previous, cb.Flight)
        if len(poses) < self.least:
            return None
        last = poses[-1]
        t = np.array([pose.capture_s for pose in poses]) - last.capture_s
        p = np.array([pose.X_WO[:3, 3] for pose in poses]) - 0.5 * np.outer(t**2, GRAVITY)
        (v, at), *_ = np.linalg.lstsq(np.stack([t, np.ones_like(t)], axis=1), p, rcond=None)
        assert last.information.shape == (6, 6) and last.residual_m < 0.01
        return cb.Flight(last.capture_s, at, v, covariance=1e-6 * np.eye(6))


class Ours:
    """What the scenario's planner decides."""

    def __init__(self, setup: cb.Setup, seed: int, index: int) -> None:
        pass

    def plan(self, situation: cb.Situation) -> cb.Plan | None:
        return situation.ours()


class OwnMotion(Ours):
    """The first plan as a motion of one's own, which stays."""

    def plan(self, situation: cb.Situation) -> cb.Plan | None:
        assert situation.q.shape == situation.dq.shape == situation.ddq.shape == (7,)
        if situation.running is not None:
            assert situation.running.status == "plan_kept"
            return None
        plan = situation.ours()
        if plan.status != "planned":
            return None
        assert plan.knots_s[0] == situation.start_s and not situation.is_closing
        motion = cb.Trajectory(1, plan.knots_s, plan.control_points)
        return situation.catch(motion, plan.catch_s, plan.aperture_m)


def test_a_planner_that_asks_ours_gives_our_rows(setup):
    assert setup.evaluate(trials=2, planner=Ours, threads=2).jsonl == setup.evaluate(trials=2).jsonl


def test_a_predictor_and_a_motion_of_ones_own_catch(setup):
    ball = cb.Setup("paper", object="tennis_ball", throw="near_sampled")
    assert ball.evaluate(trials=2, predictor=Parabola)["caught"].all()
    table = ball.evaluate(trials=2, planner=OwnMotion)
    assert table["caught"].any() and not table["limit_violations"].any()
    assert ball.evaluate(trials=1, predictor=Parabola, planner=OwnMotion)["limit_violations"].tolist() == [0]


def test_exceptions_of_stages_come_out(setup):
    class Failing(Ours):
        def plan(self, situation):
            raise ZeroDivisionError("of the planner")

        predict = plan

    with pytest.raises(ZeroDivisionError, match="of the planner"):
        setup.evaluate(trials=20, planner=Failing)
    with pytest.raises(TypeError):
        setup.evaluate(trials=20, predictor=Failing)
    with pytest.raises(TypeError, match="^predictor: found Late, expected an object with a method predict"):
        setup.evaluate(trials=20, predictor=type("Late", (), {"__init__": lambda *_: None}))
    with pytest.raises(ValueError, match="^brain"):
        setup.evaluate(trials=20, brain=Ours, planner=Ours)

    class Babbling(Ours):
        def plan(self, situation):
            return 3

    with pytest.raises(TypeError, match="^planner: plan returned 3, expected a Plan or None"):
        setup.evaluate(trials=20, planner=Babbling)


def test_flights_are_checked():
    flight = cb.Flight(1.0, [0, 0, 1], [3, 0, 4], q=[0, 0, 0, 1], w=[1, 0, 0], drag_per_m=0.0, covariance=np.eye(6))
    assert np.allclose(flight.at(1.5), [1.5, 0, 1 + 2 - 4.905 * 0.25]) and flight.covariance(1.0)[0, 0] >= 1
    for argument, keywords in {
        "p": {"p": [0, 0]},
        "v": {"v": [0, np.nan, 0]},
        "q": {"q": [0, 0, 0, 2]},
        "w": {"w": [1e9, 0, 0]},
        "drag_per_m": {"drag_per_m": -1},
        "covariance": {"covariance": np.eye(3)},
    }.items():
        with pytest.raises(ValueError, match=rf"^{argument}\b"):
            cb.Flight(**{"time_s": 0.0, "p": [0, 0, 0], "v": [1, 0, 0]} | keywords)
