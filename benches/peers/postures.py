"""Inverse kinematics: a damped least-squares loop with Pinocchio, and optik."""

import numpy as np
import optik
import pinocchio as pin
from measure import measured, median, problems, write

MOST_STEPS, STARTS, DAMPING, NEAR = 100, 10, 1e-6, 1e-6
# Errors of pose up to which a posture is right, in m and rad.
RIGHT = 1e-5
OPTIK_S = 0.1

it = problems()
model = pin.buildModelFromUrdf(it["urdf"])
X_LG = pin.SE3(np.array(it["X_LG"]))
frame = model.addFrame(pin.Frame("grip", model.njoints - 1, 0, X_LG, pin.FrameType.OP_FRAME))
data, tip = model.createData(), next(name for name in reversed([of.name for of in model.frames if of.type == pin.FrameType.BODY]))
lower, upper = model.lowerPositionLimit, model.upperPositionLimit
robot = optik.Robot.from_urdf_file(it["urdf"], it["base"], tip)
robot.set_parallelism(1)


def error(q: np.ndarray, X_WG: pin.SE3) -> np.ndarray:
    """What is left to the pose, as a twist in the gripper's frame."""
    pin.forwardKinematics(model, data, q)
    return pin.log6(pin.updateFramePlacement(model, data, frame).actInv(X_WG)).vector


def damped_steps(X_WG: pin.SE3, start: np.ndarray) -> tuple[np.ndarray | None, int]:
    """Steps of the damped pseudoinverse, clamped to the limits, from the start and then from random ones."""
    random, q = np.random.default_rng(1), start
    for step in range(MOST_STEPS * STARTS):
        if step % MOST_STEPS == 0 and step:
            q = random.uniform(lower, upper)
        left = error(q, X_WG)
        if np.linalg.norm(left) < NEAR:
            return q, step
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL)
        q = np.clip(q + J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(6), left), lower, upper)
    return None, MOST_STEPS * STARTS


def by_optik(X_WG: pin.SE3, q: np.ndarray) -> tuple[np.ndarray | None, None]:
    config = optik.SolverConfig("speed", max_time=OPTIK_S, tol_f=NEAR**2)
    found = robot.ik(config, X_WG.homogeneous.tolist(), q.tolist(), ee_offset=X_LG.homogeneous.tolist())
    return (np.array(found[0]) if found else None), None


def call(X_WG: pin.SE3, q: np.ndarray) -> None:
    robot.fk(q.tolist(), ee_offset=X_LG.homogeneous.tolist())


cases = [(pin.SE3(np.array(case["X_WG"])), np.array(case["start"])) for case in it["cases"]]
ours = [((np.array(case["ours"]) if case["ours"] else None, None), case["time_s"]) for case in it["cases"]]
solvers = {
    "ours, closed form, all arcs": ours,
    "Pinocchio, damped least squares in Python": [measured(lambda case=case: damped_steps(*case)) for case in cases],
    "optik, speed": [measured(lambda case=case: by_optik(*case)) for case in cases],
}
rows = []
for name, results in solvers.items():
    pairs = [(q, X_WG) for ((q, _), _), (X_WG, _) in zip(results, cases, strict=True) if q is not None]
    errors = [float(np.abs(error(q, X_WG)).max()) for q, X_WG in pairs if (lower - 1e-9 <= q).all() and (q <= upper + 1e-9).all()]
    right, steps, times_us = [it for it in errors if it < RIGHT], [step for (_, step), _ in results if step], [1e6 * s for _, s in results]
    rows.append([name, len(results), len(pairs), len(right), f"{max(right, default=np.nan):.0e}", median(steps), median(times_us), max(times_us)])
solutions = median([case["solutions"] for case in it["cases"]])
columns = ["solver", "poses", "solved, as it says", "within limits and 10⁻⁵", "largest error of those, m or rad", "median steps", "median µs", "max µs"]
call_us = median([1e6 * measured(lambda case=case: call(*case))[1] for case in cases])
title = f"Inverse kinematics of 1,000 poses from random starts: {solutions:.0f} postures of ours in the median, one of the others"
rows.append(["optik, a call of its forward kinematics", *[None] * 5, call_us, None])
write((title, columns, rows))
