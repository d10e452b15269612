"""Whatever the argument, an exception names it, and the process goes on."""

from __future__ import annotations

import multiprocessing
import pickle

import numpy as np
import pytest

import catchingbot as cb

T = np.arange(8) * 0.02
P = np.stack([2 - 3 * T, 0 * T, 1 + 3 * T - 4.905 * T**2], axis=1)


def raises(argument: str, call, *arguments, **keywords):
    with pytest.raises((TypeError, ValueError), match=rf"^{argument}\b"):
        call(*arguments, **keywords)


def test_setups():
    for argument in ["robot", "gripper", "workcell", "object", "throw"]:
        raises(argument, cb.Setup, **{argument: "nonsense"})
    raises("scenario", cb.Setup, "nonsense")
    raises("method", cb.Setup, method="nonsense")
    raises("settings", cb.Setup, settings=3)
    raises("settings", cb.Setup, settings={3: 4})
    raises("settings", cb.Setup, settings={"arena.drag": object()})
    raises("settings", cb.Setup, settings={"arena.nonsense": True})
    raises("settings", cb.Setup, settings={"arena.step_s": float("nan")})
    nested: list = []
    nested.append(nested)
    raises("settings", cb.Setup, settings={"arena.drag": nested})


@pytest.mark.parametrize("value", [-1, 2**63, 1.5, "1", None, True, np.array([1, 2])])
def test_whole_numbers(setup, value):
    raises("seed", setup.run, seed=value)
    raises("index", setup.arena, index=value)
    raises("trials", setup.evaluate, value)
    if value is not None:
        raises("threads", setup.evaluate, threads=value)


def test_numpy_numbers_are_numbers(setup):
    assert setup.run(seed=np.int64(1), index=np.uint8(0)).jsonl == setup.run().jsonl


def test_callables(setup):
    raises("brain", setup.evaluate, brain=3)
    raises("progress", setup.evaluate, progress="often")


def test_flights():
    flight = cb.predict(T, P)
    raises("t", cb.predict, T[:3], P[:3])
    raises("t", cb.predict, T[::-1], P)
    raises("t", cb.predict, T + 1j, P)
    raises("t", cb.predict, np.zeros((2, 4)), P)
    raises("t", cb.predict, ["a"] * 8, P)
    raises("t", cb.predict, [[1], [2, 3]], P)
    raises("p", cb.predict, T, P[:, :2])
    raises("p", cb.predict, T, P[:7])
    raises("p", cb.predict, T, np.where(P == P[3], np.nan, P))
    raises("p", cb.predict, T, P * 1e9)
    raises("q", cb.predict, T, P, np.ones((8, 4)))
    raises("q", cb.predict, T, P, np.ones((8, 3)))
    raises("up", cb.predict, T, P, up="w")
    raises("t", flight.at, float("nan"))
    raises("t", flight.at, "now")
    raises("t", flight.at, np.zeros((2, 2)))
    with pytest.raises(cb.NoFlight, match="^p:"):
        cb.predict(T, np.stack([T, T, T + 5 * T**2], axis=1))


def test_clouds():
    rng = np.random.default_rng(1)
    raises("points", cb.register, rng.normal(size=(5, 2)), "banana")
    raises("points", cb.register, np.zeros((0, 3)), "banana")
    raises("points", cb.register, [[np.inf, 0, 0]], "banana")
    raises("reference", cb.register, np.zeros((9, 3)), "nonsense")
    raises("reference", cb.register, np.zeros((9, 3)), np.zeros((9, 3)))
    raises("noise_m", cb.register, np.zeros((9, 3)), "banana", noise_m=-1)
    assert cb.register(np.zeros((9, 3)), "banana").X_CR is None


def test_plans(setup):
    flight, q = cb.predict(T, P), setup.ready_q
    raises("q", setup.plan, q[:3], 0 * q, flight, 0.0)
    raises("q", setup.plan, q + 100, 0 * q, flight, 0.0)
    raises("dq", setup.plan, q, 0 * q + np.nan, flight, 0.0)
    raises("dq", setup.plan, q, 0 * q + 100, flight, 0.0)
    raises("flight", setup.plan, q, 0 * q, "a flight", 0.0)
    raises("flight", setup.plan, q, 0 * q, cb.predict(T, P[:, [0, 2, 1]], up="y"), 0.0)
    raises("now_s", setup.plan, q, 0 * q, flight, float("inf"))
    assert setup.plan(q, 0 * q, flight, -1e6).status != ""


def test_commands(setup):
    raises("id", cb.Trajectory, -1, np.arange(8), np.zeros((4, 7)))
    raises("knots_s", cb.Trajectory, 1, np.arange(7), np.zeros((4, 7)))
    raises("knots_s", cb.Trajectory, 1, np.zeros(8), np.zeros((4, 7)))
    raises("knots_s", cb.Trajectory, 1, [0, 0, 0, 0, 1, 1, 1, np.nan], np.zeros((4, 7)))
    raises("control_points", cb.Trajectory, 1, np.arange(8), np.zeros((4, 9)))
    raises("control_points", cb.Trajectory, 1, np.arange(8), np.zeros((4, 0)))
    raises("control_points", cb.Trajectory, 1, np.arange(8), np.zeros(4))
    raises("force_n", cb.GripperMove, 0, 0, 1, -1)
    raises("trajectory", cb.Command, "go")
    raises("gripper", cb.Command, gripper=[1])
    raises("gripper", cb.Command, gripper=3)
    arena = setup.arena()
    arena.sense()
    raises("command", arena.act, "go")
    arena.act(cb.Command(cb.Trajectory(1, [0, 0, 0, 0, 1, 1, 1, 1], np.full((4, 8), 0.1))))
    assert [it.reason for it in arena.sense().arm.rejected] == ["unknown_joint"]


def test_brains_of_other_setups(setup):
    other = cb.Setup("honest", object="banana")
    observation = setup.arena().sense()
    command = setup.brain().tick(observation)
    raises("observation", setup.brain().tick, 3)
    if len(other.cameras) != len(setup.cameras):
        arena = other.arena()
        arena.sense()
        with pytest.raises(ValueError, match="^command"):
            arena.act(command)


def test_stepping_keeps_its_order(setup):
    arena = setup.arena()
    with pytest.raises(RuntimeError, match="sense"):
        arena.act()
    arena.sense()
    with pytest.raises(RuntimeError, match="act"):
        arena.sense()
    with pytest.raises(RuntimeError, match="not done"):
        arena.row
    arena.close()
    arena.close()
    with pytest.raises(RuntimeError, match="closed"):
        arena.sense()


def caught(setup: cb.Setup) -> bytes:
    return setup.run(index=1).jsonl


def test_setups_and_tables_go_to_spawned_processes(setup):
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(caught, [setup]) == [caught(setup)]
    table = setup.evaluate(trials=1)
    again = pickle.loads(pickle.dumps(table))
    assert again.jsonl == table.jsonl and again.keys() == table.keys()
    changed = cb.Setup("paper", settings={"arena.drag": False})
    assert pickle.loads(pickle.dumps(changed)).scenario == changed.scenario
    for unpicklable in [setup.arena(), setup.brain()]:
        with pytest.raises(TypeError):
            pickle.dumps(unpicklable)
