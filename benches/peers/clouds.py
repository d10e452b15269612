"""Registration of clouds: Open3D and small_gicp from the same starts."""

import numpy as np
import open3d as o3d
import small_gicp
from measure import measured, median, problems, write

# Farthest points that correspond; as far as the worse starts are off, and a bit.
MATCHED_M = 0.03
MOST_STEPS = 50
# Mean distance of the object's whole surface from where it is, up to which a pose is right.
RIGHT_MM = 2.0

it = problems()


def open3d_of(target) -> tuple:
    surface = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(target["points"]))
    surface.normals = o3d.utility.Vector3dVector(target["normals"])
    how, until = o3d.pipelines.registration.TransformationEstimationPointToPlane(), o3d.pipelines.registration.ICPConvergenceCriteria(max_iteration=MOST_STEPS)

    def solve(cloud: np.ndarray, start: np.ndarray):
        seen = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud))
        result, s = measured(lambda: o3d.pipelines.registration.registration_icp(seen, surface, MATCHED_M, np.linalg.inv(start), how, until))
        return np.linalg.inv(result.transformation), True, s

    return solve


def small_gicp_of(kind: str):
    def prepared(target) -> tuple:
        surface = small_gicp.PointCloud(np.array(target["points"]))
        tree = small_gicp.KdTree(surface)
        small_gicp.estimate_normals_covariances(surface, tree)

        def align(seen, start):
            if kind == "GICP":
                small_gicp.estimate_covariances(seen)
            options = {"registration_type": kind, "max_correspondence_distance": MATCHED_M, "max_iterations": MOST_STEPS}
            return small_gicp.align(surface, seen, tree, init_T_target_source=np.linalg.inv(start), **options)

        def solve(cloud: np.ndarray, start: np.ndarray):
            seen = small_gicp.PointCloud(cloud)
            result, s = measured(lambda: align(seen, start))
            return np.linalg.inv(result.T_target_source), result.converged, s

        return solve

    return prepared


def error_m(target, tree, X_CR, found) -> float:
    """Mean distance of the surface at a pose from the true one: none for poses that look the same."""
    X = np.linalg.inv(X_CR) @ found
    points = target[:: max(len(target) // 500, 1)] @ X[:3, :3].T + X[:3, 3]
    return float(np.mean([np.sqrt(tree.search_knn_vector_3d(point, 1)[2][0]) for point in points]))


peers = {"Open3D, point to plane": open3d_of, "small_gicp, PLANE_ICP": small_gicp_of("PLANE_ICP"), "small_gicp, GICP": small_gicp_of("GICP")}
rows = []
for target in it["objects"]:
    surface = np.array(target["points"])
    tree = o3d.geometry.KDTreeFlann(o3d.geometry.PointCloud(o3d.utility.Vector3dVector(surface)))
    solvers = {"ours": None, **{name: make(target) for name, make in peers.items()}}
    for number, start in enumerate(it["starts"]):
        cases = [case["case"] for case in target["cases"] if case["start"] == number]
        for name, solve in solvers.items():
            found = [
                (case["ours"], case["ours"] is not None, case["time_s"]) if solve is None else solve(np.array(case["cloud"]), np.array(case["X_start"]))
                for case in cases
            ]
            errors_mm = [1e3 * error_m(surface, tree, np.array(case["X_CR"]), np.array(X)) for case, (X, *_) in zip(cases, found, strict=True) if X is not None]
            right, times_ms = [error for error in errors_mm if error < RIGHT_MM], [1e3 * s for *_, s in found]
            off = f"{1e3 * start['distance_m']:.0f} mm, {np.degrees(start['angle_rad']):.0f}°"
            rows.append([target["name"], off, name, len(found), sum(said for _, said, _ in found), len(right), median(right), median(times_ms), max(times_ms)])
columns = ["object", "start off by", "method", "clouds", "converged, as it says", "within 2 mm", "median error of those, mm", "median ms", "max ms"]
write(("Registration of 400 points of an object's visible side, 1 mm of noise, on its whole surface", columns, rows, "method"))
