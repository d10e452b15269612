"""Free rotation of rigid bodies by Euler's equations: writes free_rotation.json. Needs NumPy and SciPy."""

import json

import numpy as np
from scipy.integrate import solve_ivp

rng = np.random.default_rng(1)
DURATION_S = 0.7
SPIN_RADPS = 25.0


def rate(_, state, inertia):
    """d/dt of (q as x, y, z, w; angular velocity in the body frame)."""
    v, w, omega = state[:3], state[3], state[4:]
    return np.concatenate(
        [
            0.5 * (w * omega + np.cross(v, omega)),
            [-0.5 * v @ omega],
            np.linalg.solve(inertia, -np.cross(omega, inertia @ omega)),
        ]
    )


cases = []
for _ in range(20):
    # The box of these half sizes and this mass, turned in its own frame.
    mass = np.exp(rng.uniform(np.log(0.005), np.log(1.0)))
    x, y, z = rng.uniform(0.01, 0.1, 3)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    inertia = axes @ np.diag([y * y + z * z, z * z + x * x, x * x + y * y]) @ axes.T * mass / 3
    inertia = (inertia + inertia.T) / 2
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    omega = rng.normal(size=3)
    omega *= SPIN_RADPS / np.linalg.norm(omega)
    end = solve_ivp(
        rate, (0, DURATION_S), np.concatenate([q, omega]), "DOP853", rtol=1e-13, atol=1e-13, args=(inertia,)
    ).y[:, -1]
    cases.append(
        {
            "mass_kg": mass,
            "inertia_kgm2": inertia.tolist(),
            "start_xyzw": q.tolist(),
            "spin_in_body_radps": omega.tolist(),
            "end_xyzw": (end[:4] / np.linalg.norm(end[:4])).tolist(),
        }
    )

with open("free_rotation.json", "w") as file:
    json.dump({"duration_s": DURATION_S, "cases": cases}, file, indent=1)
