"""The example `mujoco_cell`: what the arena catches a second engine catches, too."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

import catchingbot as cb
from conftest import ROOT

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install mujoco")
EXAMPLE = ROOT / "examples/mujoco_cell"


@pytest.mark.parametrize(("scenario", "throw"), [("paper", "near_sampled"), ("honest", "random")])
def test_ten_throws_end_alike(scenario, throw):
    command = [sys.executable, EXAMPLE / "run.py", "--scenario", scenario, "--throw", throw, "--trials", "10", "--json"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    counts = json.loads(run.stdout)
    assert counts["trials"] == sum(counts[it] for it in ["both", "arena_only", "mujoco_only", "neither"]) == 10
    assert counts["arena_only"] + counts["mujoco_only"] <= 1 and counts["both"] >= 8, counts


@pytest.fixture(scope="module")
def cell():
    sys.path.insert(0, str(EXAMPLE))
    import cell

    return cell


@pytest.mark.parametrize(("robot", "gripper"), [("iiwa14", "wsg50"), ("panda", "franka_hand"), ("ur5e", "robotiq_2f85")])
def test_the_arm_is_that_of_the_package(cell, robot, gripper):
    setup = cb.Setup("honest", robot=robot, gripper=gripper, settings={"arena.robot_errors.tool_position_m": 0.0, "arena.robot_errors.tool_rotation_deg": 0.0})
    it = cell.MujocoCell(setup, 1, 0)
    rng = np.random.default_rng(1)
    for _ in range(5):
        q = rng.uniform(setup.limits[0], setup.limits[1])
        it.data.qpos[: setup.dof] = q
        mujoco.mj_kinematics(it.model, it.data)
        hand, X_WG = it.data.body("gripper"), setup.robot.gripper_pose(q)
        np.testing.assert_allclose(hand.xpos, X_WG[:3, 3], atol=1e-9)
        np.testing.assert_allclose(hand.xmat.reshape(3, 3), X_WG[:3, :3], atol=1e-9)


def test_images_are_those_of_the_arena(cell):
    """Without errors of the cameras every pixel shows what the arena shows."""
    setup = cb.Setup("paper", settings={"arena.labels": False})
    it, seen = cell.MujocoCell(setup, 1, 0), setup.arena().sense()
    for ours, theirs in zip(seen.frames[:3], it.sense().frames[:3], strict=True):
        one, other = ours.depth_m, theirs.depth_m
        assert one.shape == other.shape and (np.isnan(one) != np.isnan(other)).mean() < 2e-3
        both = ~np.isnan(one) & ~np.isnan(other)
        assert both.any() and (np.abs(one[both] - other[both]) > 2e-3).mean() < 0.02


def test_flights_are_those_of_the_arena(cell):
    setup = cb.Setup("honest", object="banana")
    it, drawn = cell.MujocoCell(setup, 1, 0), setup.conditions(1, 0)
    while it.time_s < 0.4:
        it.tick()
    np.testing.assert_allclose(it.drawn["release"]["position_m"], drawn["release"]["position_m"])
    flown = it.data.body("object").xpos - drawn["release"]["position_m"]
    v, k = np.array(drawn["release"]["velocity_mps"]), drawn["drag_per_m"]
    # Small steps of the same law.
    p, w = np.zeros(3), v.copy()
    for _ in range(40_000):
        p, w = p + 1e-5 * w, w + 1e-5 * (np.array([0, 0, -9.81]) - k * np.linalg.norm(w) * w)
    np.testing.assert_allclose(flown, p, atol=1e-3)


BENCH = """
<mujoco>
  <option timestep="0.0005" cone="elliptic" impratio="100" gravity="0 0 0"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body pos="0 0 0.03"><freejoint/><geom name="ball" size="0.03" mass="0.1"/></body>
  </worldbody>
  <contact><pair geom1="ball" geom2="floor" solreffriction="0.0035 1"/></contact>
</mujoco>
"""


@pytest.mark.parametrize("thing", ["tennis_ball", "banana", "pill_bottle"])
def test_an_object_bounces_as_in_the_arena(thing):
    """A ball with the contacts of the exported scene meets a plane at 3 m/s, at several instants of a step."""
    setup, bench = cb.Setup("honest", object=thing), mujoco.MjModel.from_xml_string(BENCH)
    for index in range(5):
        scene, rebounds = mujoco.MjModel.from_xml_string(setup.mjcf(1, index)), []
        bench.pair_solref[0], bench.pair_solimp[0] = scene.pair_solref[0], scene.pair_solimp[0]
        for instant in (np.arange(10) + 0.5) / 10:
            data = mujoco.MjData(bench)
            data.qpos[2], data.qvel[2] = 0.03 + instant * 3.0 * bench.opt.timestep, -3.0
            mujoco.mj_step(bench, data, 60)
            rebounds.append(data.qvel[2] / 3.0)
        drawn = setup.conditions(1, index)
        assert np.mean(rebounds) == pytest.approx(drawn["restitution"], abs=0.01), rebounds
        assert scene.pair_friction[0, 0] == pytest.approx(drawn["friction"])


def test_a_ball_is_squeezed_as_its_file_says(cell):
    """By F/k at each finger."""
    import model

    setup = cb.Setup("honest", object="tennis_ball")
    drawn = setup.conditions(1, 0)
    it = model.scene(setup, 1, 0, drawn)
    it.opt.gravity[:] = 0
    data, n = mujoco.MjData(it), setup.dof
    data.qpos[:n], data.qpos[n : n + 2] = setup.ready_q, 0.034
    mujoco.mj_kinematics(it, data)
    X_WG = np.r_[np.c_[data.body("gripper").xmat.reshape(3, 3), data.body("gripper").xpos], [[0, 0, 0, 1]]]
    data.joint("object").qpos[:3] = (X_WG @ [0, setup.gripper.numbers["grasp_centre_y_m"], 0, 1])[:3]
    it.dof_damping[:] = 50.0
    it.pair_solref[:, 1] = -2 * np.sqrt(-it.pair_solref[:, 0])
    data.qfrc_applied[n : n + 2] = -60.0
    mujoco.mj_step(it, data, 4000)
    squeezed_m = (0.0672 - data.qpos[n : n + 2].sum()) / 2
    assert squeezed_m == pytest.approx(60 / 24000, rel=0.1)


@pytest.mark.parametrize(("scenario", "robot", "gripper"), [("honest", "iiwa14", "wsg50"), ("lab", "panda", "franka_hand"), ("paper", "ur5e", "robotiq_2f85")])
def test_mujoco_loads_the_scene_without_a_warning(scenario, robot, gripper):
    setup = cb.Setup(scenario, robot=robot, gripper=gripper, object="banana", workcell="table_and_fence")
    model, thrown = mujoco.MjModel.from_xml_string(setup.mjcf(3, 4)), setup.conditions(3, 4)["release"]
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    body = data.body("object")
    np.testing.assert_allclose(body.xpos, thrown["position_m"], atol=1e-12)
    np.testing.assert_allclose(data.joint("object").qvel[:3], thrown["velocity_mps"], atol=1e-12)
    np.testing.assert_allclose(body.xmat.reshape(3, 3) @ data.joint("object").qvel[3:], thrown["spin_radps"], atol=1e-9)
    np.testing.assert_allclose(data.qpos[: setup.dof], setup.ready_q, atol=1e-12)
    joints, limits = setup.robot.numbers["joints"], setup.limits
    for i, joint in enumerate(joints):
        it = model.joint("arm/" + joint["name"])
        np.testing.assert_allclose(it.range, limits[:2, i])
        assert it.armature[0] == joint["rotor_inertia"] and model.body("arm/" + joint["link"]).mass[0] == joint["mass"]
        assert model.actuator("arm/" + joint["name"]).ctrlrange[1] == limits[4, i]
    for i, camera in enumerate(setup.cameras):
        np.testing.assert_allclose(data.cam(f"camera:{i}").xpos, camera.X_WC[:3, 3], atol=1e-12)
        np.testing.assert_allclose(data.cam(f"camera:{i}").xmat.reshape(3, 3) @ np.diag([1, -1, -1]), camera.X_WC[:3, :3], atol=1e-9)
        assert model.cam_fovy[i] == pytest.approx(np.degrees(2 * np.arctan(camera.size_px[1] / 2 / camera.K[0, 0])))
    assert model.ncam == len(setup.cameras) and any(model.geom(i).name.startswith("obstacle:") for i in range(model.ngeom))
    mujoco.mj_step(model, data)
    assert not any(it.number for it in data.warning)


def test_recorded_commands_catch_again(tmp_path):
    trial = cb.Setup("honest", object="tennis_ball").run(1, 0)
    file = tmp_path / "ball.catch"
    file.write_bytes(trial.recording)
    run = subprocess.run([sys.executable, EXAMPLE / "rerun.py", file, "--json"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout) == {"recording": str(file), "arena": "caught", "mujoco": "caught"}
