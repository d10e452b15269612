"""Flights of rigid bodies in air: writes free_flight.json. Needs NumPy and SciPy.

Integrated by scipy.integrate.solve_ivp (DOP853, tolerances of 1e-12), with the matrix exponentials of scipy.linalg. Quaternions are
x, y, z, w; the angular velocity is in the body frame.
"""

import json

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

G = np.array([0.0, 0.0, -9.81])


def rate(parameters, state):
    _, m, magnus, decay, s, lift = np.split(parameters, [3, 9, 10, 11, 16])
    drag = expm(np.array([[m[0], m[3], m[4]], [m[3], m[1], m[5]], [m[4], m[5], m[2]]]))
    inertia = expm(np.array([[s[0], s[2], s[3]], [s[2], s[1], s[4]], [s[3], s[4], -s[0] - s[1]]]))
    v, q, w = state[3:6], state[6:10], state[10:13]
    R = Rotation.from_quat(q)
    force = R.apply(drag @ R.inv().apply(v)) * np.linalg.norm(v)
    a = G - force + magnus * np.cross(R.apply(w), v) + np.cross(lift, v)
    turned = (Rotation.from_quat(q / np.linalg.norm(q))).as_quat()
    x, y, z, c = turned
    dq = 0.5 * np.array([c * w[0] + y * w[2] - z * w[1], c * w[1] + z * w[0] - x * w[2], c * w[2] + x * w[1] - y * w[0],
                         -x * w[0] - y * w[1] - z * w[2]])
    dw = np.linalg.solve(inertia, np.cross(inertia @ w, w)) - decay * w
    return np.concatenate([v, a, dq, dw])


def main():
    rng = np.random.default_rng(11)
    cases = []
    for i in range(8):
        parameters = np.concatenate([
            0.02 * rng.standard_normal(3), np.log(0.06) + 0.5 * rng.standard_normal(3), 0.2 * rng.standard_normal(3),
            [0.004 * rng.standard_normal(), 0.3 * rng.random()], 0.4 * rng.standard_normal(5), 0.5 * rng.standard_normal(3)])
        if i == 0:
            # Neither Magnus force nor decay.
            parameters[9:11] = parameters[16:19] = 0
        q = Rotation.random(random_state=i).as_quat()
        start = np.concatenate([rng.standard_normal(3), 5 * rng.standard_normal(3), q, 8 * rng.standard_normal(3)])
        found = solve_ivp(lambda _, y: rate(parameters, y), (0, 0.7), start, method="DOP853", rtol=1e-12, atol=1e-13)
        end = found.y[:, -1]
        end[6:10] /= np.linalg.norm(end[6:10])
        cases.append({"parameters": parameters.tolist(), "start": start.tolist(), "duration_s": 0.7, "end": end.tolist()})
    with open("free_flight.json", "w", encoding="utf-8") as file:
        json.dump(cases, file, indent=1)
        file.write("\n")


main()
