"""Flights with aerodynamic forces by adaptive integration: writes aerodynamics.json. Needs NumPy and SciPy."""

import json

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

rng = np.random.default_rng(2)
DURATION_S = 0.7
GRAVITY = np.array([0.0, 0.0, -9.81])


def rate(_, state, case):
    """d/dt of (p; v; q as x, y, z, w; angular velocity in the body frame)."""
    v, q, omega = state[3:6], state[6:10], state[10:]
    R = Rotation.from_quat(q / np.linalg.norm(q)).as_matrix()
    u = v - case["wind"]
    drag = R @ (case["drag"] @ (R.T @ u)) * np.linalg.norm(u)
    magnus = case["magnus"] * np.cross(R @ omega, u)
    inertia = case["inertia"]
    return np.concatenate(
        [
            v,
            GRAVITY - drag + magnus,
            0.5 * (q[3] * omega + np.cross(q[:3], omega)),
            [-0.5 * q[:3] @ omega],
            np.linalg.solve(inertia, -np.cross(omega, inertia @ omega)) - case["decay"] * omega,
        ]
    )


def unit(size):
    vector = rng.normal(size=size)
    return vector / np.linalg.norm(vector)


cases = []
for _ in range(20):
    mass = np.exp(rng.uniform(np.log(0.005), np.log(1.0)))
    x, y, z = rng.uniform(0.01, 0.1, 3)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    inertia = axes @ np.diag([y * y + z * z, z * z + x * x, x * x + y * y]) @ axes.T * mass / 3
    drag_per_m = rng.uniform(0.01, 0.15)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    deviation = axes @ np.diag(rng.uniform(-0.9, 0.9, 3)) @ axes.T
    case = {
        "inertia": (inertia + inertia.T) / 2,
        "drag": drag_per_m * (np.eye(3) + (deviation + deviation.T) / 2),
        "magnus": rng.uniform(0.0, 0.02),
        "decay": rng.uniform(0.0, 1.0),
        "wind": rng.uniform(-2.0, 2.0, 3),
    }
    q, omega = unit(4), unit(3) * rng.uniform(5.0, 25.0)
    v = np.array([-3.0, -4.0, 3.5]) + rng.normal(size=3)
    start = np.concatenate([np.zeros(3), v, q, omega])
    end = solve_ivp(rate, (0, DURATION_S), start, "DOP853", rtol=1e-12, atol=1e-12, args=(case,)).y[:, -1]
    R = Rotation.from_quat(end[6:10] / np.linalg.norm(end[6:10]))
    cases.append(
        {
            "mass_kg": mass,
            "inertia_kgm2": case["inertia"].tolist(),
            "drag_per_m": drag_per_m,
            "drag_deviation": ((deviation + deviation.T) / 2).tolist(),
            "magnus": case["magnus"],
            "spin_decay_per_s": case["decay"],
            "wind_mps": case["wind"].tolist(),
            "start_xyzw": q.tolist(),
            "start_velocity_mps": v.tolist(),
            "start_spin_in_body_radps": omega.tolist(),
            "end_position_m": end[:3].tolist(),
            "end_velocity_mps": end[3:6].tolist(),
            "end_xyzw": R.as_quat().tolist(),
            "end_spin_radps": R.apply(end[10:]).tolist(),
        }
    )

with open("aerodynamics.json", "w") as file:
    json.dump({"duration_s": DURATION_S, "cases": cases}, file, indent=1)
