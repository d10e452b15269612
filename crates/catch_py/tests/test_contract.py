"""The contract as data: what a cell of one's own hands to a brain and takes from it."""

from __future__ import annotations

import gc
import inspect
import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import catchingbot as cb
from conftest import ROOT

IDENTITY = np.eye(4)
K = np.array([[600.0, 0, 320], [0, 600.0, 240], [0, 0, 1]])


def same(one: cb.Observation, other: cb.Observation) -> bool:
    arms = all(np.array_equal(getattr(one.arm, it), getattr(other.arm, it)) for it in ["q", "dq", "commanded"])
    states = [(it.time_s, it.arm.time_s, it.arm.executing, it.gripper.width_m, it.gripper.speed_mps, it.gripper.force_n, it.gripper.grasp) for it in [one, other]]
    frames = [
        a.camera == b.camera and a.capture_s == b.capture_s and a.window == b.window
        and np.array_equal(a.depth_m, b.depth_m, equal_nan=True) and (a.mask is None) == (b.mask is None)
        for a, b in zip(one.frames, other.frames, strict=True)
    ]
    return arms and states[0] == states[1] and all(frames)


def made_again(seen: cb.Observation) -> cb.Observation:
    """By the constructors, from what can be read, the images in another order."""
    arm = cb.ArmState(seen.arm.time_s, seen.arm.q, seen.arm.dq, seen.arm.commanded, seen.arm.executing, seen.arm.rejected)
    gripper = cb.GripperState(seen.gripper.width_m, seen.gripper.speed_mps, seen.gripper.force_n, seen.gripper.grasp)
    frames = [cb.DepthFrame(it.camera, it.capture_s, it.depth_m, it.window, it.mask) for it in seen.frames]
    return cb.Observation(seen.time_s, arm, gripper, frames)


@pytest.mark.parametrize("scenario", ["paper", "honest"])
def test_observations_that_are_made_again_lead_to_the_same_commands(scenario):
    setup = cb.Setup(scenario)
    arena, ours, theirs = setup.arena(), setup.brain(), setup.brain()
    commands = 0
    while not arena.done and commands < 120:
        seen = arena.sense()
        again = made_again(seen)
        assert same(seen, again)
        one, other = ours.tick(seen), theirs.tick(again)
        trajectory = pickle.loads(pickle.dumps(other.trajectory))
        assert (one.trajectory is None) == (trajectory is None) and one.windows == other.windows
        if one.trajectory is not None:
            assert one.trajectory.id == trajectory.id
            np.testing.assert_array_equal(one.trajectory.control_points, trajectory.control_points)
            np.testing.assert_array_equal(one.trajectory.knots_s, trajectory.knots_s)
        moves = [None if of.gripper is None else [(m.start_s, m.width_m, m.speed_mps, m.force_n) for m in of.gripper] for of in [one, other]]
        assert moves[0] == moves[1]
        arena.act(one)
        commands += 1
    assert ours.status == theirs.status == "committed"


def test_what_is_no_depth():
    depths = np.array([[0.0, np.nan, np.inf], [1.0, 2.0, 3.0]])
    frame = cb.DepthFrame(3, 0.5, depths, (4, 5, 3, 2), depths > 1)
    np.testing.assert_array_equal(frame.depth_m, np.array([[np.nan] * 3, [1, 2, 3]], np.float32))
    assert frame.window == (4, 5, 3, 2) and frame.camera == 3 and frame.mask.sum() == 3
    assert cb.DepthFrame(0, 0.0, np.zeros((0, 0))).window == (0, 0, 0, 0)


def test_images_are_shared_and_not_lost():
    """An observation takes its images over without a copy; their objects show them as before."""
    depths = np.arange(6, dtype=np.float32).reshape(2, 3) + 1
    frame, arm, gripper = cb.DepthFrame(0, 0.5, depths, mask=depths > 2), cb.ArmState(1, np.zeros(7), np.zeros(7)), cb.GripperState(0.1)
    made = [cb.Observation(1, arm, gripper, [frame, frame]), cb.Observation(1, arm, gripper, [frame])]
    depths += 1
    del arm
    for it in [frame, *made[0].frames, *made[1].frames]:
        np.testing.assert_array_equal(it.depth_m, depths - 1)
        np.testing.assert_array_equal(it.mask, depths - 1 > 2)


def raises(argument: str, call, *arguments, **keywords):
    with pytest.raises((TypeError, ValueError), match=rf"^{argument}\b"):
        call(*arguments, **keywords)


def test_states_that_cannot_be():
    q = np.zeros(7)
    arm, gripper, ones = cb.ArmState(0, q, q), cb.GripperState(0.1), np.ones((2, 3))
    raises("q", cb.ArmState, 0, np.zeros(9), q)
    raises("dq", cb.ArmState, 0, q, np.zeros(6))
    raises("commanded", cb.ArmState, 0, q, q, np.zeros((2, 7)))
    raises("rejected", cb.ArmState, 0, q, q, rejected=["late"])
    raises("executing", cb.ArmState, 0, q, q, executing=-1)
    raises("reason", cb.Rejection, 1, "nonsense")
    raises("width_m", cb.GripperState, np.nan)
    raises("grasp", cb.GripperState, 0.1, grasp="firm")
    raises("camera", cb.DepthFrame, -1, 0, ones)
    raises("capture_s", cb.DepthFrame, 0, np.inf, ones)
    # Whole numbers would be millimetres.
    raises("depth_m", cb.DepthFrame, 0, 0, np.ones((2, 3), np.uint16))
    raises("depth_m", cb.DepthFrame, 0, 0, -ones)
    raises("depth_m", cb.DepthFrame, 0, 0, np.ones(3))
    raises("window", cb.DepthFrame, 0, 0, ones, (0, 0, 2, 3))
    raises("mask", cb.DepthFrame, 0, 0, ones, mask=np.ones((3, 2), bool))
    raises("mask", cb.DepthFrame, 0, 0, ones, mask=ones)
    raises("arm", cb.Observation, 0, None, gripper)
    raises("gripper", cb.Observation, 0, arm, None)
    raises("frames", cb.Observation, 0, arm, gripper, [ones])
    raises("frames", cb.Observation, 0, arm, gripper, [cb.DepthFrame(0, 0.1, ones)])
    raises("K", cb.Camera, np.diag([1.0, 2.0, 1.0]), (640, 480), IDENTITY)
    raises("size_px", cb.Camera, K, (0, 480), IDENTITY)
    raises("X_WC", cb.Camera, K, (640, 480), 2 * IDENTITY)
    raises("sheet", cb.Camera, K, (640, 480), IDENTITY, sheet="nonsense")


def test_ten_thousand_hostile_calls():
    """Whatever the arguments: a value, or an exception that names the argument."""
    rng = np.random.default_rng(1)
    values = [0, 1, -1, 2**64, 1.5, math.nan, math.inf, -1e300, 1e12, True, None, "late", b"x", [], [1, [2]], {}, object(), np.zeros(0)]
    values += [np.zeros(7), np.full(7, np.nan), np.zeros((3, 7)), np.ones((2, 3)), np.ones((2, 3), np.uint16), np.zeros((0, 5)), np.ones((2, 2, 2))]
    values += [(0, 0, 3, 2), (0, 0, 2**40, 1), IDENTITY, K, np.ones((4, 4)), (640, 480), 1j, np.array(["a"]), np.ones((2, 3), bool), Path("x")]
    arm, gripper = cb.ArmState(0, np.zeros(7), np.zeros(7)), cb.GripperState(0.1)
    values += [arm, gripper, cb.DepthFrame(0, 0.0, np.ones((2, 3))), [cb.DepthFrame(0, 0.0, np.ones((2, 3)))], cb.Rejection(1), [cb.Rejection(1)]]
    counts = {cb.ArmState: 6, cb.GripperState: 4, cb.DepthFrame: 5, cb.Observation: 4, cb.Camera: 3, cb.Rejection: 3, cb.Command: 3, cb.GripperMove: 4, cb.Trajectory: 3, cb.judge: 2}
    made = 0
    for _ in range(10_000):
        kind = list(counts)[rng.integers(len(counts))]
        arguments = [values[it] for it in rng.integers(len(values), size=rng.integers(1, counts[kind] + 1))]
        try:
            kind(*arguments)
            made += 1
        except (TypeError, ValueError) as fault:
            told = " ".join([str(fault), *getattr(fault, "__notes__", [])])
            assert any(name in told for name in inspect.signature(kind).parameters), (kind, told)
    assert 50 < made < 9000


def test_paths_are_names(tmp_path):
    setup = cb.Setup(ROOT / "assets/scenarios/paper.toml", object=ROOT / "assets/objects/banana")
    assert pickle.loads(pickle.dumps(setup)).scenario == setup.scenario
    assert cb.Gripper(ROOT / "assets/grippers/wsg50.toml").toml == setup.gripper.toml
    assert cb.Robot(ROOT / "assets/robots/iiwa14").urdf == setup.robot.urdf
    raises("robot", cb.Setup, robot=3)
    raises("ready_q", cb.Robot, "iiwa14", ready_q=np.full(7, 9.0))
    raises("gripper", cb.Gripper, 3)


def test_the_executor_is_that_of_the_cell(setup):
    executor, q, still = cb.Executor(setup.robot, setup.gripper), setup.ready_q, np.zeros(7)
    ends = np.linspace(0, 1, 6)[:, None] ** 0 * q
    motion = cb.Trajectory(1, [0.1] * 4 + [0.4, 0.7] + [1.0] * 4, ends)
    assert executor.receive(motion, 0.0) is None
    late = executor.receive(cb.Trajectory(2, [0.1] * 4 + [0.4, 0.7] + [1.0] * 4, ends), 0.5)
    assert (late.id, late.reason) == (2, "late") and late.details["by_s"] == pytest.approx(0.4)
    np.testing.assert_allclose(executor.advance(0.6), [q, still, still], atol=1e-9)
    state = executor.arm_state(0.6, q, still)
    assert state.executing == 1 and [it.reason for it in state.rejected] == ["late"]
    assert [(it.id, it.details) for it in state.rejected] == [(2, late.details)]
    assert executor.arm_state(0.7, q, still).rejected == []
    queue = cb.GripperQueue()
    queue.receive([cb.GripperMove(0.3, 0.0, 0.4, 40.0), cb.GripperMove(0.1, 0.1, 0.4, 40.0)], 0.0)
    assert queue.take_due(0.12, 0.03) is None and queue.take_due(0.13, 0.03).width_m == 0.1


def sphere(radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 25)[:-1], np.linspace(0, np.pi, 13), indexing="ij")
    points = radius_m * np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1).reshape(-1, 3)
    corner = lambda i, j: 13 * (i % 24) + j
    faces = [[corner(i, j), corner(i, j + 1), corner(i + 1, j + 1)] for i in range(24) for j in range(12)]
    faces += [[corner(i, j), corner(i + 1, j + 1), corner(i + 1, j)] for i in range(24) for j in range(12)]
    return points, np.array(faces)


def test_brains_without_a_scenario(setup):
    cameras = [cb.Camera(it.K, it.size_px, it.X_WC, sheet="perfect") for it in setup.cameras]
    for one, again in zip(setup.cameras, cameras, strict=True):
        np.testing.assert_array_equal(one.K, again.K)
        np.testing.assert_allclose(one.X_WC, again.X_WC, atol=1e-12)
        assert one.size_px == again.size_px
    known = {"mass_kg": 0.058, "drag_per_m": 0.0, "drag_sd_per_m": 0.0}
    make = lambda thing, **more: cb.Brain(setup.robot, setup.gripper, cameras, thing, known=known, **more)
    arena = cb.Setup("paper").arena()
    brains = [make("tennis_ball"), make(sphere(0.0336))]
    for _ in range(25):
        seen = arena.sense()
        commands = [brain.tick(seen) for brain in brains]
        arena.act(commands[0])
    for brain in brains:
        # 0.25 s into the flight both know where the ball goes.
        assert brain.flight is not None, brain.status
        np.testing.assert_allclose(brain.flight.at(0.4), brains[0].flight.at(0.4), atol=5e-3)
    raises("object", make, (np.zeros((3, 3)), [[0, 1, 3]]))
    raises("object", make, 3)
    raises("config", make, "tennis_ball", config={"control.nonsense": 1})
    raises("known", cb.Brain, setup.robot, setup.gripper, cameras, "tennis_ball", known={"mass_kg": 99})
    raises("cameras", cb.Brain, setup.robot, setup.gripper, [], "tennis_ball")


def test_a_hand_is_mounted_as_the_file_of_its_arm_says():
    robot, hand = cb.Robot("panda"), cb.Gripper("franka_hand")
    setup = cb.Setup("honest", robot="panda", gripper="franka_hand")
    X_WG = robot.gripper_pose(robot.ready_q, hand)
    np.testing.assert_allclose(X_WG, setup.robot.gripper_pose(robot.ready_q), atol=1e-12)
    assert np.abs(X_WG - robot.gripper_pose(robot.ready_q)).max() > 0.1
    assert list(robot.numbers["X_LF_by_gripper"]) == ["franka_hand"]


def test_an_observation_of_another_cell_is_refused(setup):
    brain, q, state = setup.brain(), np.zeros(7), cb.GripperState(0.1)
    tick = lambda dof, *frames: brain.tick(cb.Observation(0.0, cb.ArmState(0, q[:dof], q[:dof]), state, frames))
    raises("observation", tick, 6)
    raises("observation", tick, 7, cb.DepthFrame(len(setup.cameras), 0.0, np.ones((2, 2))))
    raises("observation", tick, 7, cb.DepthFrame(0, 0.0, np.ones((2, 2)), (8000, 0, 2, 2)))


def test_recordings_of_own_cells_are_replayed(setup, program, tmp_path):
    arena, brain = setup.arena(), setup.brain()
    recorder = cb.Recorder(tmp_path / "own.catch", brain)
    for _ in range(30):
        seen = arena.sense()
        command = brain.tick(seen)
        recorder.tick(seen, command)
        arena.act(command)
    recorder.finish()
    with pytest.raises(RuntimeError, match="finished"):
        recorder.finish()
    run = subprocess.run([program, "replay", tmp_path / "own.catch"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr + run.stdout
    raises("file", cb.Recorder, tmp_path / "own.txt", brain)


def test_conditions_are_told(setup):
    drawn = cb.Setup("honest").conditions(seed=2, index=3)
    row = cb.Setup("honest").evaluate(trials=1, seed=2, first=3).rows()[0]
    assert drawn["release"] == row["conditions"]["release"] and drawn["friction"] == row["conditions"]["friction"]
    assert len(drawn["cameras"]) == len(setup.cameras) and len(drawn["link_mass_ratios"]) == 7


def held(*, until_s: float = 2.0, **change) -> dict[str, np.ndarray]:
    """Samples of a catch: the fingers touch at 0.5 s and hold from then on."""
    t = np.arange(0, until_s + 5e-4, 1e-3)
    contacts = np.zeros((len(t), 6))
    contacts[t >= 0.5 - 1e-9, :2] = 1
    X = np.tile(IDENTITY, (len(t), 1, 1))
    return {"time_s": t, "X_WG": X, "X_WO": X, "width_m": 0 * t + 0.06, "commanded_width_m": 0 * t, "dq": np.zeros((len(t), 7)), "contacts": contacts} | change


def test_the_referee_judges_any_cell():
    assert cb.judge(held(), 1.5) is None
    assert cb.judge(held(until_s=1.9), 1.5) is not None
    assert cb.judge(held(commanded_width_m=0.1 + 0 * held()["time_s"]), 1.5) == "missed_position"
    floor = held()
    floor["contacts"][700, 4] = 1
    assert cb.judge(floor, 1.5) == "hit_floor"
    assert cb.judge(held(dq=held()["dq"] + 0.1), 1.5) == "moved_on"
    lost = held()
    lost["contacts"][1600:] = 0
    assert cb.judge(lost, 1.5) == "dropped"
    raises("samples", cb.judge, 3)
    raises("samples: dq", cb.judge, held(dq=np.zeros((3, 7))))
    raises("samples: X_WG", cb.judge, {it: value for it, value in held().items() if it != "X_WG"})


def test_threads_share_what_cannot_change(setup):
    """Observations, a brain and an executor in eight threads, while the garbage collector runs."""
    brain, executor, q = setup.brain(), cb.Executor(setup.robot, setup.gripper), setup.ready_q
    frames, faults = [cb.DepthFrame(it, 0.0, np.ones((20, 20))) for it in range(3)], []

    def work():
        try:
            for _ in range(50):
                seen = cb.Observation(0.0, executor.arm_state(0.0, q, 0 * q), cb.GripperState(0.1), frames)
                assert same(seen, made_again(seen)) and brain.tick(seen).trajectory is None
                gc.collect(0)
        except Exception as fault:
            faults.append(fault)

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not faults, faults


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_an_interrupt_ends_a_run_within_a_second():
    begin = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    setup = "cb.Setup('lab')"
    code = f"{begin}; import catchingbot as cb; setup = {setup}; print('go', flush=True); setup.run()"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        try:
            assert child.stdout.readline() == "go\n"
            time.sleep(0.5)
            os.kill(child.pid, signal.SIGINT)
            began_s = time.monotonic()
            _, errors = child.communicate(timeout=30)
            took_s = time.monotonic() - began_s
        finally:
            child.kill()
    assert "KeyboardInterrupt" in errors and took_s < 1.0, (took_s, errors)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="fork")
def test_a_forked_process_goes_on(setup):
    code = "import os, catchingbot as cb; s = cb.Setup('paper'); s.arena().sense(); p = os.fork()\nif p == 0: os._exit(0 if s.run().caught else 1)\nassert os.waitpid(p, 0)[1] == 0"
    run = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=False, timeout=120)
    assert run.returncode == 0, run.stderr


def test_recordings_have_the_scene_the_commands_and_the_truth(tmp_path):
    setup = cb.Setup("honest", object="banana", settings={"arena.restitution_scale": 0.9})
    file = tmp_path / "banana.catch"
    for index in range(3):
        trial = setup.run(2, index)
        file.write_bytes(trial.recording)
        it = cb.Recording(file)
        assert (it.seed, it.index, it.reason) == (2, index, trial.reason)
        assert cb.judge(it.samples, it.disturbed_since_s) is None or trial.reason is not None
        # The same scene and the same commands have the same end; the reason of a miss is the brain's part, too.
        again = it.setup
        assert again.conditions(2, index) == setup.conditions(2, index)
        with pytest.raises(TypeError, match="recording"):
            pickle.dumps(again)
        arena, commands = again.arena(2, index), iter(it.commands)
        while not arena.done:
            seen, (time_s, command) = arena.sense(), next(commands)
            assert seen.time_s == time_s
            arena.act(command)
        assert all(arena.row[it] == trial.row[it] for it in ["caught", "contact_s", "peak_contact_impulse_ns"])
    raises("file", cb.Recording, 3)
    (tmp_path / "none.catch").write_bytes(b"x")
    with pytest.raises(ValueError, match="none.catch"):
        cb.Recording(tmp_path / "none.catch")
