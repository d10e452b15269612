"""The scene of a throw in MuJoCo: the exported one, with what is drawn for the throw."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np

import catchingbot as cb


def matrix(position, xyzw) -> np.ndarray:
    """A frame from its position and orientation, as 4×4."""
    X, R = np.eye(4), np.zeros(9)
    mujoco.mju_quat2Mat(R, np.roll(xyzw, 1))
    X[:3, :3], X[:3, 3] = R.reshape(3, 3), position
    return X


def exported(setup: cb.Setup, *throw: int) -> mujoco.MjModel:
    """The scene as exported."""
    xml = setup.mjcf(*throw)
    if not hasattr(mujoco.mjtMeshInertia, "mjMESH_INERTIA_SHELL"):
        # MuJoCo 3.2 has no inertia of shells, and the object's is stated.
        xml = xml.replace('inertia="shell"', "")
    return mujoco.MjModel.from_xml_string(xml)


def nominal(setup: cb.Setup) -> mujoco.MjModel:
    """The scene with nominal values, as the arm's controller believes it to be. Nothing touches anything, and no joint has a stop."""
    model = exported(setup)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return model


def scene(setup: cb.Setup, seed: int, index: int, drawn: dict) -> mujoco.MjModel:
    """The scene under the conditions that are drawn for a throw."""
    model = exported(setup, seed, index)
    for joint, ratio in zip(setup.robot.numbers["joints"], drawn["link_mass_ratios"], strict=True):
        link = model.body("arm/" + joint["link"]).id
        model.body_mass[link] *= ratio
        model.body_inertia[link] *= ratio
    hand, mount = model.body("gripper").id, drawn["gripper_mount"]
    off = matrix(model.body_pos[hand], np.roll(model.body_quat[hand], -1)) @ matrix(mount["position_m"], mount["orientation_xyzw"])
    model.body_pos[hand] = off[:3, 3]
    mujoco.mju_mat2Quat(model.body_quat[hand], off[:3, :3].flatten())
    model.pair_friction[:, :3] *= max(drawn["friction"], 1e-5) / model.pair_friction[0, 0]
    stiffness, impedance = -model.pair_solref[0, 0], model.pair_solimp[0, 0]
    model.pair_solref[:, 1] = -damping(round(drawn["restitution"], 2), stiffness, impedance)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


BENCH = """
<mujoco>
  <option timestep="0.0005" cone="elliptic" impratio="100"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body pos="0 0 0.0301"><freejoint/><geom name="ball" size="0.03" mass="0.1"/></body>
  </worldbody>
  <contact><pair geom1="ball" geom2="floor" solref="-{} -{}" solreffriction="0.0035 1" solimp="{} {} 0.001 0.5 2"/></contact>
</mujoco>
"""


def bounce(damped: float, stiffness: float, impedance: float) -> float:
    """How fast a ball that meets the floor at 3 m/s leaves it, as a fraction; stiffness and damping are for each kilogram."""
    model = mujoco.MjModel.from_xml_string(BENCH.format(stiffness, damped, impedance, impedance))
    data = mujoco.MjData(model)
    data.qvel[2] = -3.0
    mujoco.mj_step(model, data, 60)
    return data.qvel[2] / 3.0


@cache
def damping(restitution: float, stiffness: float, impedance: float) -> float:
    """The damping of contacts with this restitution, by bisection."""
    low, high = 0.0, 2 * np.sqrt(stiffness)
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (middle, high) if bounce(middle, stiffness, impedance) > restitution else (low, middle)
    return high
