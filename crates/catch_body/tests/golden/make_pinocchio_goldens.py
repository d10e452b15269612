"""Makes the goldens of all built-in arms' kinematics and dynamics with Pinocchio (pip install pin); see README.md."""

import json
import pathlib
import tomllib

import numpy as np
import pinocchio

HERE = pathlib.Path(__file__).parent
ROBOTS = HERE.parents[3] / "assets/robots"
STATES = 6


def states(folder, rng):
    model = pinocchio.buildModelFromUrdf(str(folder / "robot.urdf"))
    extra = tomllib.loads((folder / "robot.toml").read_text())
    value = lambda it: it["value"] if isinstance(it, dict) else it
    model.armature = np.array([value(extra["joints"][name]["rotor_inertia_kgm2"]) for name in model.names[1:]])
    model.gravity.linear = np.array([0, 0, -9.81])
    mount = extra["flange"]
    X_LG = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(*map(float, mount["rpy_rad"])), np.array(mount["position_m"]))
    frame = model.addFrame(pinocchio.Frame("gripper", model.njoints - 1, 0, X_LG, pinocchio.FrameType.OP_FRAME))
    data = model.createData()
    cases = []
    for _ in range(STATES):
        q = rng.uniform(np.maximum(model.lowerPositionLimit, -3), np.minimum(model.upperPositionLimit, 3))
        dq, ddq = rng.uniform(-2, 2, model.nv), rng.uniform(-10, 10, model.nv)
        torque = pinocchio.rnea(model, data, q, dq, ddq) + model.damping * dq
        jacobian = pinocchio.computeFrameJacobian(model, data, q, frame, pinocchio.LOCAL_WORLD_ALIGNED)
        pinocchio.framesForwardKinematics(model, data, q)
        X_WG = data.oMf[frame]
        cases.append({
            "q": q.tolist(),
            "dq": dq.tolist(),
            "ddq": ddq.tolist(),
            "torque": torque.tolist(),
            "p_WG": X_WG.translation.tolist(),
            "R_WG_rows": X_WG.rotation.tolist(),
            # Angular rows first.
            "jacobian_rows": np.vstack([jacobian[3:], jacobian[:3]]).tolist(),
        })
    return cases


robots = sorted(folder for folder in ROBOTS.iterdir() if folder.is_dir())
content = {folder.name: states(folder, np.random.default_rng(11)) for folder in robots}
rounded = json.loads(json.dumps(content), parse_float=lambda text: float(f"{float(text):.13g}"))
text = json.dumps(rounded, separators=(",", ":")).replace('{"q"', '\n{"q"').replace('"jacobian_rows"', '\n"jacobian_rows"')
(HERE / "all_arms.json").write_text(text + "\n")
