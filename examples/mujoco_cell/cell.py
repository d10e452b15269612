"""A cell in MuJoCo: it senses and acts as a real one would, and knows what really happened."""

from __future__ import annotations

import mujoco
import numpy as np

import catchingbot as cb

import model as mjcf

TICK_S = 0.001
# Until when a throw is watched: as long as the arena does.
DISTURBED_AFTER_S, DISTURBED_FOR_S, LONGEST_S = 1.0, 0.5, 5.0
PARTS = ["left", "right", "palm", "arm", "floor", "obstacle"]


class Fingers:
    """A drive that moves the fingers to a width, no faster and harder than the move says."""

    def __init__(self, gripper: dict, is_real: bool, phase_s: float | None) -> None:
        self.queue, self.gripper = cb.GripperQueue(), gripper
        self.width_m, self.rate_mps, self.move = gripper["max_width_m"], 0.0, None
        self.mass_kg = gripper["finger_mass_kg"] + (mjcf.DRIVE_KG if is_real else 0.0)
        self.acceleration = gripper["max_acceleration_mps2"] if is_real else np.inf
        self.fastest = gripper["max_speed_mps"] if is_real else np.inf
        # A real drive is critically damped at 300 rad/s, an ideal one as stiff as 1 kHz allows.
        light = min(gripper["finger_mass_kg"] / 0.05, 1.0)
        self.stiffness, self.damping = (self.mass_kg * 300.0**2, 2 * self.mass_kg * 300.0) if is_real else (10_000.0 * light, 40.0 * light)
        # A real drive takes moves and tells its state in cycles of its own.
        self.cycle_s = 1 / gripper["state_rate_hz"] if is_real else TICK_S
        self.next_cycle_s = phase_s or 0.0
        self.latency_s = max(gripper["latency_s"] - self.cycle_s / 2, 0.0) if is_real else 0.0
        self.state = cb.GripperState(self.width_m)

    def forces(self, now_s: float, at_m: np.ndarray, speed_mps: np.ndarray) -> np.ndarray:
        width_m, rate_mps = at_m.sum(), speed_mps.sum()
        if now_s + 1e-9 >= self.next_cycle_s:
            self.next_cycle_s += self.cycle_s
            while (due := self.queue.take_due(now_s, self.latency_s)) is not None:
                self.move = due
        most_n = self.gripper["max_force_n"] if self.move is None else min(self.move.force_n, self.gripper["max_force_n"])
        before_mps = self.rate_mps
        wanted = self.width_m
        if self.move is not None:
            wanted = np.clip(self.move.width_m, 0.0, self.gripper["max_width_m"])
            way, speed = wanted - self.width_m, min(self.move.speed_mps, self.fastest)
            if np.isfinite(self.acceleration):
                # It brakes in time, and waits for fingers that something keeps.
                target = np.sign(way) * min(speed, np.sqrt(2 * self.acceleration * abs(way)))
                self.rate_mps += np.clip(target - self.rate_mps, -self.acceleration * TICK_S, self.acceleration * TICK_S)
            else:
                self.rate_mps = np.sign(way) * min(speed, abs(way) / TICK_S)
            lead_m = 2 * most_n / self.stiffness
            moved = self.width_m + self.rate_mps * TICK_S
            if (wanted - moved) * way <= 0 or abs(moved - width_m) > lead_m:
                moved, self.rate_mps = np.clip(wanted if (wanted - moved) * way <= 0 else moved, width_m - lead_m, width_m + lead_m), 0.0
            self.width_m = moved
        ahead_n = self.mass_kg * (self.rate_mps - before_mps) / TICK_S / 2 if np.isfinite(self.acceleration) else 0.0
        opening = self.stiffness * (self.width_m - width_m) / 2 + self.damping * (self.rate_mps - rate_mps) / 2
        opening = np.clip(opening + np.clip(ahead_n, -most_n, most_n), -most_n, most_n)
        # The fingers are geared to each other.
        skew = self.stiffness * (at_m[0] - at_m[1]) / 2 + self.damping * (speed_mps[0] - speed_mps[1]) / 2
        grasp = "idle" if abs(rate_mps) < 5e-3 else "grasping" if rate_mps < 0 else "positioning"
        if self.move is not None and -opening > 0.9 * most_n and abs(rate_mps) < 5e-3:
            grasp = "holding"
        if now_s + self.cycle_s + 1e-9 >= self.next_cycle_s:
            self.state = cb.GripperState(round(width_m, 5), round(rate_mps, 5), -opening, grasp)
        return np.array([opening - skew, opening + skew])

    @property
    def commanded_m(self) -> float:
        return self.gripper["max_width_m"] if self.move is None else self.move.width_m


class Images:
    """Depth by rays, with the noise of the scenario's cameras."""

    def __init__(self, setup: cb.Setup, drawn: dict, random: np.random.Generator) -> None:
        self.random, self.labels = random, setup.scenario["arena"]["labels"]
        depth = setup.scenario["arena"]["depth"]
        self.lost, self.noise = depth["lost_frame_fraction"], depth["model"] if depth["model"] != "perfect" else {}
        if unknown := set(self.noise) - {"stereo", "gaussian"}:
            raise ValueError(f"no such noise in this example: {unknown}")
        self.cameras = setup.cameras
        self.X_WC = [mjcf.matrix(it["position_m"], it["orientation_xyzw"]) for it in drawn["cameras"]]
        self.radius_m = np.linalg.norm(setup.object["vertices"], axis=1).max()

    def object_window(self, camera: int, p_WO: np.ndarray) -> tuple[int, int, int, int]:
        """The box around the object, which a sensor that tells objects apart tracks by itself."""
        model, X_WC = self.cameras[camera], self.X_WC[camera]
        p = X_WC[:3, :3].T @ (p_WO - X_WC[:3, 3])
        if p[2] <= self.radius_m:
            return 0, 0, 0, 0
        centre = (model.K @ p)[:2] / p[2]
        reach = 1.5 * self.radius_m * model.K[0, 0] / (p[2] - self.radius_m) + 2
        low, high = (np.clip(it, 0, model.size_px).astype(int) for it in (centre - reach, centre + reach))
        return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])

    def take(self, model, data, camera: int, now_s: float, window) -> cb.DepthFrame | None:
        if self.random.random() < self.lost:
            return None
        it, X_WC = self.cameras[camera], self.X_WC[camera]
        width, height = it.size_px
        if window is None:
            window = self.object_window(camera, data.body("object").xpos) if self.labels else (0, 0, width, height)
        left, top, w, h = window
        w, h = max(min(w, width - left), 0), max(min(h, height - top), 0)
        shape, focal, centre = (h, w), it.K[0, 0], it.K[:2, 2]
        u, v = np.meshgrid(left + np.arange(w) + 0.5, top + np.arange(h) + 0.5)
        rays = np.stack([(u - centre[0]) / focal, (v - centre[1]) / focal, np.ones(shape)], axis=-1).reshape(-1, 3)
        lengths = np.linalg.norm(rays, axis=1)
        geoms, far = np.full(w * h, -1, np.int32), np.zeros(w * h)
        if w * h > 0:
            directions = (rays / lengths[:, None]) @ X_WC[:3, :3].T
            seen = np.array([0, 1, 0, 0, 0, 0], np.uint8)
            mujoco.mj_multiRay(model, data, X_WC[:3, 3].copy(), directions.ravel(), seen, 1, -1, geoms, far, None, w * h, 100.0)
        depth = np.where(geoms >= 0, far / lengths, np.nan)
        mask = (geoms == model.geom("surface").id).reshape(shape) if self.labels else None
        return cb.DepthFrame(camera, now_s, self.noisy(depth, focal).reshape(shape), (left, top, w, h), mask)

    def noisy(self, depth: np.ndarray, focal: float) -> np.ndarray:
        normal = self.random.standard_normal
        if gaussian := self.noise.get("gaussian"):
            depth = depth + gaussian["sd_m"] * normal(depth.shape)
        if stereo := self.noise.get("stereo"):
            sd = stereo["subpixel_px"] / (focal * stereo["baseline_m"])
            common = stereo["common_fraction"]
            depth = 1 / (1 / depth + sd * (np.sqrt(common) * normal() + np.sqrt(1 - common) * normal(depth.shape)))
            depth[self.random.random(depth.shape) < stereo["dropout_fraction"]] = np.nan
        return np.where(depth > 0, depth, np.nan).astype(np.float32)


class MujocoCell:
    """One throw. `sense` waits for the next images, `act` passes a command on."""

    def __init__(self, setup: cb.Setup, seed: int, index: int) -> None:
        drawn, arena = setup.conditions(seed, index), setup.scenario["arena"]
        self.setup, self.drawn, self.dof = setup, drawn, setup.dof
        self.random = np.random.default_rng([seed, index])
        is_real = arena["gripper"] == "real"
        self.model = mjcf.scene(setup, drawn, mjcf.DRIVE_KG if is_real else 0.0)
        self.data, self.nominal = mujoco.MjData(self.model), mjcf.nominal(setup)
        self.believed = mujoco.MjData(self.nominal)
        self.executor = cb.Executor(setup.robot, setup.gripper)
        self.fingers = Fingers(setup.gripper.numbers, is_real, drawn["gripper_phase_s"])
        self.images = Images(setup, drawn, self.random)
        self.gains, self.errors = arena["robot_controller"]["gains"], arena["robot_errors"]
        clock = setup.scenario["clock"]
        self.compute_s = 1e-3 * clock["fixed_ms"] if isinstance(clock, dict) else 0.0
        self.latency_s, self.period = arena["latency_s"], round(1 / (arena["frame_rate_hz"] * TICK_S))
        self.windows, self.commands, self.frames = None, [], []
        self.ticks, self.has_sensed, self.contact_s, self.disturbed_s, self.floor_s, self.deflected_s = 0, False, None, None, None, None
        self.samples: dict[str, list] = {it: [] for it in ["time_s", "X_WG", "X_WO", "width_m", "commanded_width_m", "dq", "contacts"]}
        names = [self.model.geom(i).name.split(":")[0] for i in range(self.model.ngeom)]
        self.part = np.array([PARTS.index(it) if it in PARTS else -1 for it in names])
        self.release(drawn["release"])

    def release(self, thrown: dict) -> None:
        widest_m = self.setup.gripper.numbers["max_width_m"]
        self.data.qpos[: self.dof + 2] = [*self.setup.ready_q, widest_m / 2, widest_m / 2]
        X_WO = mjcf.matrix(thrown["position_m"], thrown["orientation_xyzw"])
        at = self.data.joint("object")
        at.qpos = [*X_WO[:3, 3], *np.roll(thrown["orientation_xyzw"], 1)]
        # MuJoCo has the angular velocity in the body's own axes.
        at.qvel = [*thrown["velocity_mps"], *X_WO[:3, :3].T @ thrown["spin_radps"]]
        self.believed.qpos[self.dof :] = widest_m / 4
        mujoco.mj_forward(self.model, self.data)
        self.note(np.zeros(6, bool))

    @property
    def time_s(self) -> float:
        return self.ticks * TICK_S

    def sense(self) -> cb.Observation:
        """Time passes until the next images; what is sensed then."""
        for _ in range(self.period if self.has_sensed else 0):
            self.tick()
        self.has_sensed = True
        now_s = self.time_s
        for camera in range(len(self.images.cameras)):
            window = None if self.windows is None else self.windows[camera]
            if (frame := self.images.take(self.model, self.data, camera, now_s, window)) is not None:
                self.frames.append((now_s + self.latency_s, frame))
        arrived = [frame for at_s, frame in self.frames if at_s <= now_s + 1e-9]
        self.frames = [it for it in self.frames if it[0] > now_s + 1e-9]
        return cb.Observation(now_s, self.executor.arm_state(now_s, *self.encoders()), self.fingers.state, arrived)

    def act(self, command: cb.Command) -> None:
        self.commands.append((self.time_s + self.compute_s, command))
        self.deliver()

    def deliver(self) -> None:
        """What has arrived goes where it belongs; what is rejected the executor tells the brain."""
        while self.commands and self.commands[0][0] <= self.time_s + 1e-9:
            at_s, command = self.commands.pop(0)
            if command.trajectory is not None:
                self.executor.receive(command.trajectory, at_s)
            if command.gripper is not None:
                self.fingers.queue.receive(command.gripper, at_s)
            self.windows = command.windows

    def encoders(self) -> tuple[np.ndarray, np.ndarray]:
        q, step = self.data.qpos[: self.dof], self.errors["encoder_step_rad"]
        q = q + self.errors["encoder_sd_rad"] * self.random.standard_normal(self.dof)
        return np.round(q / step) * step if step > 0 else q, self.data.qvel[: self.dof].copy()

    def torques(self) -> np.ndarray:
        """Computed torque with the model that the controller has of the arm."""
        (q, dq), n = self.encoders(), self.dof
        wanted_q, wanted_dq, wanted_ddq = self.executor.advance(self.time_s)
        believed = self.believed
        believed.qpos[:n], believed.qvel[:n] = q, dq
        believed.qacc[:n] = wanted_ddq + self.gains["proportional_per_s2"] * (wanted_q - q) + self.gains["derivative_per_s"] * (wanted_dq - dq)
        mujoco.mj_inverse(self.nominal, believed)
        limit = self.setup.limits[4]
        return np.clip(believed.qfrc_inverse[:n], -limit, limit)

    def air(self) -> np.ndarray:
        """Force of the air on the object."""
        it, drawn = self.data.joint("object"), self.drawn
        R = self.data.body("object").xmat.reshape(3, 3)
        u = it.qvel[:3] - drawn["wind_mps"]
        drag = -drawn["drag_per_m"] * np.linalg.norm(u) * (u + R @ np.asarray(drawn["drag_deviation"]) @ R.T @ u)
        return drawn["mass_kg"] * (drag + drawn["magnus"] * np.cross(R @ it.qvel[3:], u))

    def tick(self) -> None:
        self.deliver()
        n, data = self.dof, self.data
        data.qfrc_applied[:n] = self.torques()
        data.qfrc_applied[n : n + 2] = self.fingers.forces(self.time_s, data.qpos[n : n + 2], data.qvel[n : n + 2])
        data.body("object").xfrc_applied[:3] = self.air()
        self.model.opt.gravity[:] = [0, 0, -9.81]
        if self.contact_s is not None and self.time_s >= self.contact_s + DISTURBED_AFTER_S - 1e-9:
            self.disturbed_s = self.time_s if self.disturbed_s is None else self.disturbed_s
            self.model.opt.gravity += 5.0 / np.sqrt(3) * np.sin(4 * np.pi * (self.time_s - self.disturbed_s))
        if self.contact_s is not None and self.time_s >= self.contact_s + 0.15:
            # What is held does not bounce.
            rate = 1 / (self.model.pair_solref[:, 0] * self.model.pair_solref[:, 1])
            self.model.pair_solref[:, 0], self.model.pair_solref[:, 1] = 1 / rate, 1.0
        # A tumbling object needs an integrator of higher order; contacts need none.
        is_far = np.linalg.norm(data.body("object").xpos - data.body("gripper").xpos) > 0.3
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4 if is_far else mujoco.mjtIntegrator.mjINT_EULER
        touched = np.zeros(6, bool)
        for _ in range(round(TICK_S / mjcf.STEP_S)):
            mujoco.mj_step(self.model, data)
            touched |= self.touching()
        self.ticks += 1
        mujoco.mj_kinematics(self.model, data)
        self.note(touched)

    def touching(self) -> np.ndarray:
        touched, force = np.zeros(6, bool), np.zeros(6)
        for i, contact in enumerate(self.data.contact):
            mujoco.mj_contactForce(self.model, self.data, i, force)
            if force[0] > 0:
                touched[max(self.part[contact.geom1], self.part[contact.geom2])] = True
        return touched

    def note(self, touched: np.ndarray) -> None:
        X = lambda it: np.block([[it.xmat.reshape(3, 3), it.xpos[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
        n, data = self.dof, self.data
        values = [self.time_s, X(data.body("gripper")), X(data.body("object")), data.qpos[n : n + 2].sum(), self.fingers.commanded_m, data.qvel[:n].copy(), touched.astype(float)]
        for field, value in zip(self.samples.values(), values, strict=True):
            field.append(value)
        first = lambda before, touches: self.time_s if before is None and touches else before
        self.contact_s = first(self.contact_s, touched[:3].any())
        self.floor_s, self.deflected_s = first(self.floor_s, touched[4]), first(self.deflected_s, touched[3] or touched[5])

    @property
    def done(self) -> bool:
        """Whether the referee has seen enough."""
        has_passed = lambda since, wait: since is not None and self.time_s >= since + wait - 1e-9
        if self.time_s < 0.875:
            return False
        if has_passed(self.floor_s, 0.2):
            return True
        if self.contact_s is not None:
            return has_passed(self.disturbed_s, DISTURBED_FOR_S)
        return has_passed(self.deflected_s, 1.0) or self.time_s >= LONGEST_S

    def why_not_caught(self) -> str | None:
        return cb.judge(self.samples, self.disturbed_s)
