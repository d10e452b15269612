"""Reference fit of a flight with aerodynamics: writes aerodynamic_flight.json. Needs NumPy and SciPy.

All unknowns at once (the state at every sample and the parameters) by scipy.optimize.least_squares: the same posterior as
`flights::aerodynamics`, found without a filter. States are (p, v, q, w), quaternions x, y, z, w.
"""

import json

import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

G = np.array([0.0, -9.81, 0.0])
DOF = 4.0
ROWS, STEP_S = 24, 0.01
MEAN = np.array([0.005, -0.01, 0, 0.07, 0.09, 0.03, 0, 0.005, 0, 0.003, 0.2, 0.2, -0.3, 0.1, 0, 0])
SD = np.array([0.005] * 3 + [0.02] * 6 + [0.001, 0.1] + [0.1] * 5)
ACCELERATION_NOISE, ANGULAR_NOISE = 0.1, 0.8
POSITION_SD, ORIENTATION_SD = 5e-4, 5e-3


def body(parameters):
    d = parameters[3:9]
    drag = np.array([[d[0], d[3], d[4]], [d[3], d[1], d[5]], [d[4], d[5], d[2]]])
    s = parameters[11:16]
    shape = np.array([[s[0], s[2], s[3]], [s[2], s[1], s[4]], [s[3], s[4], -s[0] - s[1]]])
    return parameters[:3], drag, parameters[9], parameters[10], expm(shape), expm(-shape)


def step(p, v, R, w, b, h):
    """The midpoint rule for many states at once."""
    _, drag, magnus, decay, inertia, inverse = b

    def spin(w):
        return np.cross(w @ inertia.T, w) @ inverse.T - decay * w

    def acceleration(v, R, w):
        speed = np.linalg.norm(v, axis=1, keepdims=True)
        force = R.apply(R.inv().apply(v) @ drag.T) * speed
        return G - force + magnus * np.cross(R.apply(w), v)

    w_middle = w + spin(w) * h / 2
    R_middle = R * Rotation.from_rotvec(w * h / 2)
    v_middle = v + acceleration(v, R, w) * h / 2
    a = acceleration(v_middle, R_middle, w_middle)
    return p + v * h + a * h * h / 2, v + a * h, R * Rotation.from_rotvec(w_middle * h), w + spin(w_middle) * h


def unpack(x, R0):
    states = x[16:].reshape(-1, 12)
    R = R0 * Rotation.from_rotvec(states[:, 6:9])
    return x[:16], states[:, 0:3], states[:, 3:6], R, states[:, 9:12]


def main():
    rng = np.random.default_rng(3)
    truth = MEAN + 0.7 * SD * rng.standard_normal(16)
    b = body(truth)
    state = (np.array([[0.0, 1.0, 3.0]]), np.array([[0.5, 4.0, -5.0]]),
             Rotation.from_euler("xyz", [[0.3, -0.4, 0.9]]), np.array([[9.0, -6.0, 4.0]]))
    times, positions, quaternions = [], [], []
    for i in range(ROWS):
        times.append(i * STEP_S)
        positions.append(state[0][0] + state[2].apply(b[0])[0] + POSITION_SD * rng.standard_normal(3))
        noisy = state[2] * Rotation.from_rotvec(ORIENTATION_SD * rng.standard_normal((1, 3)))
        quaternions.append(noisy.as_quat()[0])
        p, v, R, w = step(*state, b, STEP_S)
        state = (p, v + ACCELERATION_NOISE * STEP_S**0.5 * rng.standard_normal((1, 3)), R,
                 w + ANGULAR_NOISE * STEP_S**0.5 * rng.standard_normal((1, 3)))
    positions[9] = positions[9] + np.array([0.02, -0.01, 0.03])
    positions, quaternions = np.round(positions, 6), np.round(quaternions, 8)
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    measured = Rotation.from_quat(quaternions)

    h = STEP_S
    block = np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
    whiten = np.linalg.inv(np.linalg.cholesky(block))

    def robust(errors, sd):
        s = (errors**2).sum(1) / sd**2
        factor = np.sqrt((DOF + 3) * np.where(s > 1e-12, np.log1p(s / DOF) / np.maximum(s, 1e-12), 1 / DOF))
        return (errors / sd * factor[:, None]).ravel()

    def residuals(x):
        parameters, p, v, R, w = unpack(x, measured)
        b = body(parameters)
        p1, v1, R1, w1 = step(p[:-1], v[:-1], R[:-1], w[:-1], b, h)
        translation = np.stack([p[1:] - p1, v[1:] - v1], 1) / ACCELERATION_NOISE
        rotation = np.stack([(R1.inv() * R[1:]).as_rotvec(), w[1:] - w1], 1) / ANGULAR_NOISE
        return np.concatenate([
            (parameters - MEAN) / SD,
            np.einsum("ij,njk->nik", whiten, translation).ravel(),
            np.einsum("ij,njk->nik", whiten, rotation).ravel(),
            robust(positions - p - R.apply(b[0]), POSITION_SD),
            robust((R.inv() * measured).as_rotvec(), ORIENTATION_SD),
        ])

    start = np.zeros((ROWS, 12))
    start[:, 0:3] = positions
    start[:, 3:6] = np.gradient(positions, h, axis=0)
    rates = (measured[:-1].inv() * measured[1:]).as_rotvec() / h
    start[:-1, 9:12], start[-1, 9:12] = rates, rates[-1]
    # 300 unknowns by finite differences in a scale of their own: no need for an analytic Jacobian.
    scale = np.concatenate([SD, np.tile([1e-3] * 3 + [1e-2] * 3 + [1e-2] * 3 + [0.1] * 3, ROWS)])
    found = least_squares(lambda y: residuals(y * scale), np.concatenate([MEAN, start.ravel()]) / scale, jac="3-point",
                          method="trf", xtol=1e-14, ftol=1e-14, gtol=1e-10, max_nfev=60)
    parameters, p, v, R, w = unpack(found.x * scale, measured)
    end = body(parameters)
    print("cost", found.cost, "optimality", found.optimality, "passes", found.nfev)
    golden = {
        "g": list(G), "mean": list(MEAN), "sd": list(SD),
        "acceleration_noise": ACCELERATION_NOISE, "angular_acceleration_noise": ANGULAR_NOISE,
        "position_sd_m": POSITION_SD, "orientation_sd_rad": ORIENTATION_SD,
        "samples": [[t, *xyz, *q] for t, xyz, q in zip(times, positions.tolist(), quaternions.tolist())],
        "parameters": parameters.tolist(),
        "end": {"position": (p[-1] + R[-1].apply(end[0])).tolist(),
                "velocity": (v[-1] + R[-1].apply(np.cross(w[-1], end[0]))).tolist(),
                "orientation": R[-1].as_quat().tolist()},
        "parameter_sd": np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac))[:16] * SD**2).tolist(),
    }
    with open("aerodynamic_flight.json", "w", encoding="utf-8") as file:
        json.dump(golden, file, indent=1)
        file.write("\n")


main()
