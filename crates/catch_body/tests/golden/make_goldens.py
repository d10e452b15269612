"""Makes the goldens of the arm's kinematics and dynamics with MuJoCo (pip install mujoco); see README.md."""

import json
import math
import pathlib
import tomllib
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np

HERE = pathlib.Path(__file__).parent
ROOT = HERE.parents[3]
WIDTH_M = 0.055
STARTS = {
    "in_a_plane": [0.0, 0.5, 0.0, -1.0, 0.0, 0.5, 0.0],
    "of_the_paper": [1.57, 0.5, 0.0, -1.2, 0.0, 0.8, 1.57],
    "twisted": [0.3, 0.9, -0.7, 1.1, 0.5, -0.9, 0.4],
}
rng = np.random.default_rng(7)


def numbers(text):
    return [float(word) for word in text.split()]


def quaternion(rpy):
    """URDF's fixed-axis roll, pitch, yaw as MuJoCo's w, x, y, z."""
    result = np.zeros(4)
    mujoco.mju_euler2Quat(result, np.array(rpy), "XYZ")
    return result


def model(gripper_width_m, with_rotor_and_damping):
    urdf = ElementTree.parse(ROOT / "assets/robots/iiwa14/robot.urdf").getroot()
    extra = tomllib.loads((ROOT / "assets/robots/iiwa14/robot.toml").read_text())
    hand = tomllib.loads((ROOT / "assets/grippers/wsg50.toml").read_text())
    links = {link.get("name"): link for link in urdf.findall("link")}
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = [0, 0, -9.81]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.timestep = 2.5e-5
    body = spec.worldbody
    for joint in urdf.findall("joint"):
        origin = joint.find("origin")
        body = body.add_body(pos=numbers(origin.get("xyz")), quat=quaternion(numbers(origin.get("rpy"))))
        hinge = body.add_joint(name=joint.get("name"), axis=numbers(joint.find("axis").get("xyz")))
        if with_rotor_and_damping:
            hinge.armature = extra["joints"][joint.get("name")]["rotor_inertia_kgm2"]
            hinge.damping = [float(joint.find("dynamics").get("damping")), 0, 0]
        inertial = links[joint.find("child").get("link")].find("inertial")
        inertia = inertial.find("inertia")
        body.mass = float(inertial.find("mass").get("value"))
        body.ipos = numbers(inertial.find("origin").get("xyz"))
        body.inertia = [float(inertia.get(key)) for key in ("ixx", "iyy", "izz")]
        body.explicitinertial = True
    flange = body.add_body(name="flange", pos=extra["flange"]["position_m"], quat=quaternion(extra["flange"]["rpy_rad"]))
    gripper = flange.add_body(name="gripper", pos=[0, hand["body_size_m"][1] / 2, 0])
    x = (gripper_width_m + hand["finger_size_m"][0]) / 2
    boxes = [(hand["body_mass_kg"], hand["body_size_m"], [0, 0, 0])]
    boxes += [(hand["finger_mass_kg"], hand["finger_size_m"], [s * x, hand["finger_centre_y_m"], 0]) for s in (-1, 1)]
    for mass, size, centre in boxes:
        geom = gripper.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=np.array(size) / 2, pos=centre, mass=mass)
        geom.contype = geom.conaffinity = 0
    return spec.compile()


def states():
    cases = []
    plain, full = model(WIDTH_M, False), model(WIDTH_M, True)
    for _ in range(20):
        q, dq, ddq = rng.uniform(-2, 2, 7), rng.uniform(-2, 2, 7), rng.uniform(-10, 10, 7)
        case = {"q": q.tolist(), "dq": dq.tolist(), "ddq": ddq.tolist()}
        for name, m in (("torque_without_rotors", plain), ("torque", full)):
            d = mujoco.MjData(m)
            d.qpos, d.qvel, d.qacc = q, dq, ddq
            mujoco.mj_inverse(m, d)
            case[name] = d.qfrc_inverse.tolist()
        gripper = full.body("gripper").id
        jac_p, jac_r = np.zeros((3, 7)), np.zeros((3, 7))
        mujoco.mj_jac(full, d, jac_p, jac_r, d.xpos[gripper], gripper)
        w, x, y, z = d.xquat[gripper]
        case["p_WG"] = d.xpos[gripper].tolist()
        case["q_WG_xyzw"] = [x, y, z, w]
        case["jacobian_rows"] = np.vstack([jac_r, jac_p]).tolist()
        cases.append(case)
    return {"gripper_width_m": WIDTH_M, "cases": cases}


def free_motions():
    cases = []
    for with_rotor_and_damping in (False, True):
        m = model(0.110, with_rotor_and_damping)
        for name, start in STARTS.items():
            d = mujoco.MjData(m)
            d.qpos = start
            samples = []
            for i in range(501):
                while d.time < i * 1e-3 - 1e-9:
                    mujoco.mj_step(m, d)
                if i % 20 == 0:
                    samples.append({"time_s": round(i * 1e-3, 6), "q": d.qpos.tolist(), "dq": d.qvel.tolist()})
            cases.append({"start": name, "rotors_and_damping": with_rotor_and_damping, "samples": samples})
    return {"gripper_width_m": 0.110, "cases": cases}


def write(path, content):
    rounded = json.loads(json.dumps(content), parse_float=lambda text: float(f"{float(text):.12g}"))
    path.write_text(json.dumps(rounded, separators=(",", ":")).replace('{"', '\n{"') + "\n")


assert math.isclose(quaternion([0, 0, math.pi / 2])[3], math.sqrt(0.5))
write(HERE / "arm_dynamics.json", states())
write(ROOT / "crates/catch_sim/tests/golden/free_motion.json", free_motions())
