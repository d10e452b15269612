"""The scene of a throw in MuJoCo: the exported one, with what is drawn for the throw."""

import catchingbot as cb
import mujoco
import numpy as np


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
    """The scene of a throw, which has its friction and restitution, with the masses and the mount that are drawn for it."""
    model = exported(setup, seed, index)
    for joint, ratio in zip(setup.robot.numbers["joints"], drawn["link_mass_ratios"], strict=True):
        link = model.body("arm/" + joint["link"]).id
        model.body_mass[link] *= ratio
        model.body_inertia[link] *= ratio
    hand, mount = model.body("gripper").id, drawn["gripper_mount"]
    off = matrix(model.body_pos[hand], np.roll(model.body_quat[hand], -1)) @ matrix(mount["position_m"], mount["orientation_xyzw"])
    model.body_pos[hand] = off[:3, 3]
    mujoco.mju_mat2Quat(model.body_quat[hand], off[:3, :3].flatten())
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model
