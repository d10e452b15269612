"""Motions to a given state in a given time: Drake's KinematicTrajectoryOptimization and Ruckig."""

import math

import numpy as np
from measure import measured, median, problems, write
from pydrake.planning import KinematicTrajectoryOptimization
from pydrake.solvers import IpoptSolver, SnoptSolver
from ruckig import InputParameter, Result, Ruckig, Trajectory

it = problems()
lower, upper, speed, acceleration = (np.array(it[key]) for key in ["lower_rad", "upper_rad", "velocity_radps", "acceleration_radps2"])
dof, samples = len(lower), np.linspace(0, 1, it["samples"])
OUTSIDE = 1e-6
SAMPLED = 1e-4


def kinematic(case: dict, solver) -> tuple:
    """Least ∫ acceleration² with as many control points as ours; only the solver is measured."""
    ((q, dq), (q_end, dq_end)), duration_s = case_state(case), case["duration_s"]
    problem = KinematicTrajectoryOptimization(dof, it["control_points"], 4, duration_s)
    problem.AddDurationConstraint(duration_s, duration_s)
    problem.AddPositionBounds(lower, upper)
    problem.AddVelocityBounds(-speed, speed)
    problem.AddAccelerationBounds(-acceleration, acceleration)
    for s, position, velocity in [(0, q, dq), (1, q_end, dq_end)]:
        problem.AddPathPositionConstraint(position, position, s)
        problem.AddPathVelocityConstraint(velocity * duration_s, velocity * duration_s, s)
    program, bending = problem.prog(), bending_of(problem.basis().knots()) / duration_s**3
    for row in problem.control_points():
        program.AddQuadraticCost(2 * bending, np.zeros(len(row)), row, is_convex=True)
    result, time_s = measured(lambda: solver.Solve(program, program.initial_guess(), None))
    if not result.is_success():
        return None, time_s
    path = problem.ReconstructTrajectory(result)
    derivatives = [path, path.MakeDerivative(1), path.MakeDerivative(2)]
    return (path.end_time(), sampled(path.end_time(), lambda t: [of.value(t).ravel() for of in derivatives])), time_s


def bending_of(knots) -> np.ndarray:
    """∫ (q″)² of a cubic spline as a form of its control points."""
    of, knots = np.eye(len(knots) - 4), np.array(knots)
    for degree, t in [(3, knots[1:-1]), (2, knots[2:-2])]:
        of = np.diff(of, axis=0) * (degree / (t[degree:] - t[:-degree]))[:, None]
    # q″ is linear between the knots.
    low, high, span = of[:-1], of[1:], np.diff(knots[3:-3])[:, None] / 3
    half = low.T @ (span * high)
    return low.T @ (span * low) + (half + half.T) / 2 + high.T @ (span * high)


def ruckig(case: dict, least_s: float | None) -> tuple:
    """Bounded acceleration without a bound on jerk; in the least time, or in the given one."""
    otg, given, path = Ruckig(dof), InputParameter(dof), Trajectory(dof)
    (given.current_position, given.current_velocity), (given.target_position, given.target_velocity) = case_state(case)
    given.max_velocity, given.max_acceleration, given.max_jerk = speed, acceleration, [math.inf] * dof
    if least_s:
        given.minimum_duration = least_s
    result, time_s = measured(lambda: otg.calculate(given, path))
    if result not in (Result.Working, Result.Finished):
        return None, time_s
    return (path.duration, sampled(path.duration, lambda t: path.at_time(t)[:3])), time_s


def case_state(case: dict) -> list:
    return [[np.array(part) for part in case[end]] for end in ["start", "end"]]


def sampled(duration_s: float, at) -> np.ndarray:
    return np.array([at(t) for t in samples * duration_s])


def judged(case: dict, found: tuple) -> dict:
    """Residuals of a motion: at its ends and against the limits, by samples."""
    duration_s, path = found
    ends = np.abs(np.array([path[0, :2], path[-1, :2]]) - np.array(case_state(case))).max()
    q, dq, ddq = path[:, 0], path[:, 1], path[:, 2]
    ratio = max((np.abs(q - (upper + lower) / 2) / ((upper - lower) / 2)).max(), (np.abs(dq) / speed).max(), (np.abs(ddq) / acceleration).max())
    late = duration_s / case["duration_s"]
    good = ends < SAMPLED and ratio < 1 + SAMPLED and late < 1 + OUTSIDE
    return {"good": good, "end": ends, "ratio": ratio, "late": late, "effort": duration_s * np.trapezoid((ddq**2).sum(1), samples)}


solvers = {
    "ours": lambda case: ((case["duration_s"], np.array(case["ours"])) if case["ours"] else None, case["time_s"]),
    "Drake, SNOPT": lambda case: kinematic(case, SnoptSolver()),
    "Drake, IPOPT": lambda case: kinematic(case, IpoptSolver()),
    "Ruckig, least time": lambda case: ruckig(case, None),
    "Ruckig, given time": lambda case: ruckig(case, case["duration_s"]),
}
rows = []
for name, solve in solvers.items():
    results = [(case, *solve(case)) for case in it["cases"]]
    verdicts = [judged(case, found) for case, found, _ in results if found]
    good, times_ms = [verdict for verdict in verdicts if verdict["good"]], [1e3 * s for *_, s in results]
    end, ratio = (max((float(verdict[key]) for verdict in verdicts), default=math.nan) for key in ["end", "ratio"])
    middle = [median([float(verdict[key]) for verdict in good]) for key in ["late", "effort"]]
    rows.append([name, len(results), len(verdicts), len(good), f"{end:.0e}", f"{max(ratio - 1, 0):.0e}", *middle, median(times_ms), max(times_ms)])
columns = ["solver", "problems", "solved, as it says", "within limits and time", "largest error at the ends, rad or rad/s", "most above a limit, of it"]
columns += ["duration / given", "∫ acceleration², rad²/s³", "median ms", "max ms"]
write(("Motions from the arm's state to the state of a planned catch, in the time that is left", columns, rows))
