"""Reference refinement of a calibration by flights: writes refined_calibration.json. Needs NumPy and SciPy.

All unknowns at once by scipy.optimize.least_squares: of each camera a rotation vector and a translation in its frame, depth scale, time
offset and three offsets of the registration; the tilt; of each flight position, velocity, drag and three offsets of each camera.
"""

import json

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

G = np.array([0.0, 0.0, -9.81])
CAMERAS, FLIGHTS, TIMES = 2, 4, np.arange(0.0, 0.7, 0.05)
OF_CAMERA, OF_FLIGHT = 11, 7 + 3 * CAMERAS
# Those of `catch_calibration::flights`.
TILT_SD = np.radians(0.05)
DRAG_SD = 0.1
OFFSET_SD = np.array([0.0002, 0.0002, 0.01])
FLIGHT_OFFSET_SD = np.array([0.0003, 0.0003, 0.005])


def looking(position):
    z = np.array([0.0, 1.0, 1.0]) - position
    z /= np.linalg.norm(z)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    return position, Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))


def positions(state, drag, tilt, times):
    g = G + np.cross([tilt[0], tilt[1], 0.0], G)

    def rate(_, y):
        return np.concatenate([y[3:], g - drag * np.linalg.norm(y[3:]) * y[3:]])

    # From the middle both ways, at any times.
    span = 0.5
    solve = lambda end: solve_ivp(rate, (0.0, end), state, method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True).sol
    before, after = solve(-span), solve(span)
    return np.array([(before if t < 0 else after)(t)[:3] for t in times])


def sighted(camera, by, p_W, rays, offset):
    position, rotation = camera
    R = rotation * Rotation.from_rotvec(by[:3])
    q = R.inv().apply(p_W - (position + rotation.apply(by[3:6])))
    b = by[8:11] + offset
    return (1 + by[6]) * q + np.column_stack([np.full(len(q), b[0]), np.full(len(q), b[1]), np.zeros(len(q))]) + rays * b[2]


def main():
    rng = np.random.default_rng(5)
    cameras = [looking(np.array([1.6, -1.2, 2.0])), looking(np.array([-1.0, -0.4, 0.4]))]
    sd = np.tile([5e-4] * 3 + [1e-3] * 3 + [1e-3, 2e-4], CAMERAS)
    mixing = rng.standard_normal((8 * CAMERAS, 4))
    prior = np.diag(sd**2) + (sd[:, None] * mixing) @ (sd[:, None] * mixing).T
    error = np.linalg.cholesky(prior) @ rng.standard_normal(8 * CAMERAS)
    tilt = TILT_SD * rng.standard_normal(2)
    true_by = np.zeros((CAMERAS, OF_CAMERA))
    true_by[:, :8] = error.reshape(CAMERAS, 8)
    true_by[:, 8:] = OFFSET_SD * rng.standard_normal((CAMERAS, 3))
    flights, starts = [], []
    for _ in range(FLIGHTS):
        state = np.concatenate([np.array([0.0, 1.5, 1.5]) + 0.2 * rng.standard_normal(3),
                                np.array([0.0, -4.0, 0.0]) + 0.6 * rng.standard_normal(3)])
        drag = 0.01 + 0.003 * rng.standard_normal()
        rows = []
        for i, camera in enumerate(cameras):
            stamps = TIMES - 0.35 + 0.003 * i
            p_W = positions(state, drag, tilt, stamps + true_by[i, 7])
            R = camera[1]
            rays = R.inv().apply(p_W - camera[0])
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            clean = sighted(camera, true_by[i], p_W, rays, FLIGHT_OFFSET_SD * rng.standard_normal(3))
            for t, p, u in zip(stamps, clean, rays):
                C = 1e-6 * np.eye(3) + (1e-4 - 1e-6) * np.outer(u, u)
                # Less than it says, so that no residual counts less for its size.
                p = p + 0.7 * np.linalg.cholesky(C) @ rng.standard_normal(3)
                rows.append((i, 20.0 + t, p, C))
        flights.append(rows)
        starts.append(np.concatenate([state, [drag]]))
    factor = np.linalg.inv(np.linalg.cholesky(prior))
    whitenings = [[np.linalg.inv(np.linalg.cholesky(C)) for _, _, _, C in rows] for rows in flights]

    def residuals(x):
        by = x[:OF_CAMERA * CAMERAS].reshape(CAMERAS, OF_CAMERA)
        tilt = x[OF_CAMERA * CAMERAS:][:2]
        all_ = [factor @ by[:, :8].ravel(), (by[:, 8:] / OFFSET_SD).ravel(), tilt / TILT_SD]
        for k, rows in enumerate(flights):
            own = x[OF_CAMERA * CAMERAS + 2 + OF_FLIGHT * k:][:OF_FLIGHT]
            offsets = own[7:].reshape(CAMERAS, 3)
            all_ += [[own[6] / DRAG_SD], (offsets / FLIGHT_OFFSET_SD).ravel()]
            for i, camera in enumerate(cameras):
                mine = [(j, row) for j, row in enumerate(rows) if row[0] == i]
                stamps = np.array([row[1] for _, row in mine]) - 20.0
                seen = np.array([row[2] for _, row in mine])
                rays = seen / np.linalg.norm(seen, axis=1, keepdims=True)
                p_W = positions(own[:6], own[6], tilt, stamps + by[i, 7])
                off = seen - sighted(camera, by[i], p_W, rays, offsets[i])
                all_ += [whitenings[k][j] @ o for (j, _), o in zip(mine, off)]
        return np.concatenate(all_)

    x = np.zeros(OF_CAMERA * CAMERAS + 2 + OF_FLIGHT * FLIGHTS)
    for k, start in enumerate(starts):
        x[OF_CAMERA * CAMERAS + 2 + OF_FLIGHT * k:][:7] = start
    scale = np.concatenate([np.tile(np.concatenate([sd[:8], OFFSET_SD]), CAMERAS), [TILT_SD] * 2] +
                           [np.concatenate([[1e-3] * 3, [1e-2] * 3, [1e-2], np.tile(FLIGHT_OFFSET_SD, CAMERAS)])] * FLIGHTS)
    fit = least_squares(lambda y: residuals(y * scale), x / scale, jac="3-point", xtol=1e-12, ftol=1e-12, gtol=1e-12)
    assert fit.success
    x = fit.x * scale
    deviations = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac))) * scale
    by = x[:OF_CAMERA * CAMERAS].reshape(CAMERAS, OF_CAMERA)
    sizes = [np.linalg.norm(fit.fun[-3 * n:][:3]) for n in range(1, 20)]
    assert max(sizes) < 3
    refined = []
    for i, (position, rotation) in enumerate(cameras):
        R = rotation * Rotation.from_rotvec(by[i, :3])
        refined.append({"p": (position + rotation.apply(by[i, 3:6])).tolist(), "rotation_vector": R.as_rotvec().tolist(),
                        "depth_scale": by[i, 6], "time_offset_s": by[i, 7],
                        "sd": deviations[OF_CAMERA * i:][:8].tolist()})
    tilt_at = OF_CAMERA * CAMERAS
    json.dump({
        "cameras": [{"p": p.tolist(), "rotation_vector": R.as_rotvec().tolist()} for p, R in cameras],
        "prior_covariance": prior.ravel().tolist(),
        "flights": [[[i, t, *p.tolist(), *C.ravel().tolist()] for i, t, p, C in rows] for rows in flights],
        "refined": refined,
        "tilt_rad": x[tilt_at:][:2].tolist(),
        "tilt_sd_rad": deviations[tilt_at:][:2].tolist(),
    }, open("refined_calibration.json", "w"))


if __name__ == "__main__":
    main()
