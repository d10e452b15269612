"""Writes forward_dynamics.json: accelerations of random arms with two fingers, by Pinocchio's articulated bodies.

    pip install pin && python make_forward_dynamics.py
"""

import json
from pathlib import Path

import numpy as np
import pinocchio as pin

rng = np.random.default_rng(7)


def direction():
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def quaternion():
    return pin.Quaternion(rng.normal(size=4)).normalized()


def inertia():
    axes = quaternion().matrix()
    moments = rng.uniform(0.5, 1.0, 3)
    mass = rng.uniform(0.1, 5.0)
    return mass, rng.uniform(-0.2, 0.2, 3), axes @ np.diag(moments) @ axes.T * mass * 0.01


def tree():
    links, model = [], pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    parents = [0, 1, 2, 3, 4, 5, 6, 7, 8, 8]
    for i, parent in enumerate(parents):
        q, p, axis = quaternion(), rng.uniform(-0.4, 0.4, 3), direction()
        mass, com, about_com = inertia()
        revolute = i < 8
        kind = pin.JointModelRevoluteUnaligned(axis) if revolute else pin.JointModelPrismaticUnaligned(axis)
        joint = model.addJoint(parent, kind, pin.SE3(q.matrix(), p), f"j{i}")
        model.appendBodyToJoint(joint, pin.Inertia(mass, com, about_com), pin.SE3.Identity())
        links.append({
            "parent": parent, "q_xyzw": q.coeffs().tolist(), "p_m": p.tolist(), "axis": axis.tolist(),
            "mass_kg": mass, "com_m": com.tolist(), "about_com_kgm2": about_com.T.flatten().tolist(),
            "rotor_inertia": rng.uniform(0.0, 0.3),
        })
    model.armature = np.array([link["rotor_inertia"] for link in links])
    data, states = model.createData(), []
    for _ in range(5):
        q, v, tau = rng.uniform(-2, 2, 10), rng.uniform(-3, 3, 10), rng.uniform(-50, 50, 10)
        q[8:] = rng.uniform(0, 0.1, 2)
        states.append({"q": q.tolist(), "v": v.tolist(), "tau": tau.tolist(),
                       "a": pin.aba(model, data, q, v, tau).tolist()})
    return {"links": links, "states": states}


Path(__file__).with_name("forward_dynamics.json").write_text(json.dumps([tree() for _ in range(12)]) + "\n")
