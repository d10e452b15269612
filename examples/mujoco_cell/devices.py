"""The gripper's drive and the cameras."""

import catchingbot as cb
import mujoco
import numpy as np
from model import matrix

TICK_S = 0.001
# MuJoCo 3.2 tells no normals, and takes no argument for them.
NORMALS = [None] if "normal:" in mujoco.mj_multiRay.__doc__ else []
# Rays meet what is to be seen, which the exported scene has in group 1, and end after 100 m.
SEEN, FAR_M = np.array([0, 1, 0, 0, 0, 0], np.uint8), 100.0


class Fingers:
    """The gripper's drive: it moves the fingers to a width, no faster and no harder than a move says."""

    def __init__(self, gripper: dict, width_m: float, is_real: bool, phase_s: float | None, drive_kg: float) -> None:
        self.queue, self.widest_m, self.most_n = cb.GripperQueue(), gripper["max_width_m"], gripper["max_force_n"]
        # The move, and the set-point that leads the fingers through it.
        self.wanted_m, self.speed_mps, self.force_n = width_m, 0.0, self.most_n
        self.width_m, self.rate_mps, self.state = width_m, 0.0, cb.GripperState(width_m)
        # What a move says that the fingers obey: all of it, the width alone, or only whether they open or close.
        self.control = gripper.get("drive", {}).get("control", "speed_and_force")
        if is_real:
            # Critically damped at 300 rad/s, with limits; it takes moves and tells its state in cycles of its own.
            kg = gripper["finger_mass_kg"] + drive_kg
            self.stiffness, self.damping, self.ahead_kg = kg * 300.0**2, 2 * kg * 300.0, kg / 2
            self.fastest, self.acceleration = gripper["max_speed_mps"], gripper["max_acceleration_mps2"]
            self.cycle_s, self.next_s = 1 / gripper["state_rate_hz"], phase_s
            self.latency_s = max(gripper["latency_s"] - self.cycle_s / 2, 0.0)
        else:
            # As stiff as 1 kHz allows, at once and without limits.
            light = min(gripper["finger_mass_kg"] / 0.05, 1.0)
            self.stiffness, self.damping, self.ahead_kg = 1e4 * light, 40 * light, 0.0
            self.fastest, self.acceleration = 1e3, 1e6
            self.cycle_s, self.next_s, self.latency_s = TICK_S, 0.0, 0.0

    def forces(self, now_s: float, at_m: np.ndarray, speed_mps: np.ndarray) -> np.ndarray:
        """Forces that open the left and the right finger in the next millisecond."""
        width_m, rate_mps, is_cycle = at_m.sum(), speed_mps.sum(), now_s + 1e-9 >= self.next_s
        # What arrives after a cycle waits for the next one.
        while is_cycle and (move := self.queue.take_due(self.next_s, self.latency_s)) is not None:
            self.begin(move)
        opening = self.stiffness * (self.width_m - width_m) / 2 + self.damping * (self.rate_mps - rate_mps) / 2
        opening = np.clip(opening + self.ahead_kg * self.advance(width_m), -self.force_n, self.force_n)
        if is_cycle:
            self.next_s += self.cycle_s
            still = abs(rate_mps) < 5e-3
            grasp = ("holding" if opening < -0.9 * self.force_n else "idle") if still else "grasping" if rate_mps < 0 else "positioning"
            self.state = cb.GripperState(round(width_m, 5), round(rate_mps, 5), -opening, grasp)
        # The fingers are geared to each other.
        skew = self.stiffness * (at_m[0] - at_m[1]) / 2 + self.damping * (speed_mps[0] - speed_mps[1]) / 2
        return np.array([opening - skew, opening + skew])

    def begin(self, move: cb.GripperMove) -> None:
        self.wanted_m, self.speed_mps, self.force_n = np.clip(move.width_m, 0.0, self.widest_m), self.fastest, self.most_n
        if self.control == "two_state":
            self.wanted_m = self.widest_m if 2 * move.width_m > self.widest_m else 0.0
        if self.control == "speed_and_force":
            self.speed_mps, self.force_n = min(move.speed_mps, self.fastest), min(move.force_n, self.most_n)

    def advance(self, actual_m: float) -> float:
        """Moves the set-point, which brakes in time and waits for fingers that something keeps. Returns its acceleration."""
        way, before_mps, change = self.wanted_m - self.width_m, self.rate_mps, self.acceleration * TICK_S
        target = np.sign(way) * min(self.speed_mps, np.sqrt(2 * self.acceleration * abs(way)))
        self.rate_mps += np.clip(target - self.rate_mps, -change, change)
        self.width_m += (before_mps + self.rate_mps) / 2 * TICK_S
        if (self.wanted_m - self.width_m) * way <= 0:
            self.width_m, self.rate_mps = self.wanted_m, 0.0
        lead_m = 2 * self.force_n / self.stiffness
        if abs(self.width_m - actual_m) > lead_m:
            self.width_m, self.rate_mps = np.clip(self.width_m, actual_m - lead_m, actual_m + lead_m), 0.0
        return (self.rate_mps - before_mps) / TICK_S


class Images:
    """The cameras: depth by MuJoCo's rays, with the noise of the scenario's."""

    def __init__(self, setup: cb.Setup, poses: list[dict], random: np.random.Generator) -> None:
        arena = setup.scenario["arena"]
        self.random, self.labels, self.lost = random, arena["labels"], arena["depth"]["lost_frame_fraction"]
        self.noise = {} if arena["depth"]["model"] == "perfect" else arena["depth"]["model"]
        self.cameras, self.radius_m = setup.cameras, np.linalg.norm(setup.object["vertices"], axis=1).max()
        self.X_WC = [matrix(it["position_m"], it["orientation_xyzw"]) for it in poses]
        self.rays = [rays_through(*it) for it in zip(self.cameras, self.X_WC, strict=True)]

    def take(self, model, data, camera: int, now_s: float, window) -> cb.DepthFrame | None:
        """The image of a camera, or the part of it that the brain wants; now and then one is lost."""
        if self.random.random() < self.lost:
            return None
        if window is None:
            window = self.object_window(camera, data.body("object").xpos) if self.labels else (0, 0, *self.cameras[camera].size_px)
        left, top, width, height = window
        rays, along = (it[top : top + height, left : left + width] for it in self.rays[camera])
        shape, count = along.shape, along.size
        geoms, far = np.full(count, -1, np.int32), np.zeros(count)
        if count > 0:
            mujoco.mj_multiRay(model, data, self.X_WC[camera][:3, 3].copy(), rays.ravel(), SEEN, 1, -1, geoms, far, *NORMALS, count, FAR_M)
        hit, depth = np.flatnonzero(geoms >= 0), np.full(count, np.nan, np.float32)
        depth[hit] = self.noisy(far[hit] * along.ravel()[hit], self.cameras[camera].K[0, 0])
        mask = (geoms == model.geom("surface").id).reshape(shape) if self.labels else None
        return cb.DepthFrame(camera, now_s, depth.reshape(shape), (left, top, shape[1], shape[0]), mask)

    def object_window(self, camera: int, p_WO: np.ndarray) -> tuple[int, int, int, int]:
        """The box around the object, which a sensor that tells objects apart tracks by itself."""
        it, X_WC = self.cameras[camera], self.X_WC[camera]
        p = X_WC[:3, :3].T @ (p_WO - X_WC[:3, 3])
        if p[2] <= self.radius_m:
            return 0, 0, 0, 0
        reach = 1.5 * self.radius_m * it.K[0, 0] / (p[2] - self.radius_m) + 2
        low, high = (np.clip((it.K @ p)[:2] / p[2] + way, 0, it.size_px).astype(int) for way in (-reach, reach))
        return (*map(int, low), *map(int, high - low))

    def noisy(self, depth: np.ndarray, focal_px: float) -> np.ndarray:
        """Stereo errs in disparity, partly in all pixels alike, and finds no depth at some."""
        if stereo := self.noise.get("stereo"):
            sd, common = stereo["subpixel_px"] / (focal_px * stereo["baseline_m"]), stereo["common_fraction"]
            error = np.sqrt(common) * self.random.standard_normal() + np.sqrt(1 - common) * self.random.standard_normal(depth.shape)
            depth = 1 / np.maximum(1 / depth + sd * error, 1e-3)
            depth[self.random.random(depth.shape) < stereo["dropout_fraction"]] = np.nan
        return depth


def rays_through(camera: cb.Camera, X_WC: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors through the centres of all pixels in the world, and their parts along the optical axis."""
    u, v = np.meshgrid(*(np.arange(it) + 0.5 for it in camera.size_px))
    rays = np.linalg.solve(camera.K, np.stack([u, v, np.ones_like(u)]).reshape(3, -1))
    rays /= np.linalg.norm(rays, axis=0)
    return np.ascontiguousarray((X_WC[:3, :3] @ rays).T).reshape(*u.shape, 3), rays[2].reshape(u.shape)
