"""A cell in MuJoCo: it senses and acts as a real one would, and knows what really happened."""

from __future__ import annotations

import model as mjcf
import mujoco
import numpy as np

import catchingbot as cb

TICK_S = 0.001
# MuJoCo 3.2 tells no normals, and takes no argument for them.
NORMALS = [None] if "normal:" in mujoco.mj_multiRay.__doc__ else []
# What can touch the object, in the order in which the referee asks for it.
PARTS = ["left", "right", "palm", "arm", "floor", "obstacle"]


class Fingers:
    """A drive that moves the fingers to a width, no faster and no harder than the move says."""

    def __init__(self, gripper: dict, is_real: bool, phase_s: float | None, drive_kg: float) -> None:
        self.queue, self.widest_m, self.most_n = cb.GripperQueue(), gripper["max_width_m"], gripper["max_force_n"]
        self.width_m, self.rate_mps, self.wanted_m, self.force_n = self.widest_m, 0.0, self.widest_m, self.most_n
        self.speed_mps, self.state = 0.0, cb.GripperState(self.widest_m)
        # What a move says that the fingers obey: all of it, the width alone, or only whether they open or close.
        self.control = gripper.get("drive", {}).get("control", "speed_and_force")
        # A real drive is critically damped at 300 rad/s and knows limits; an ideal one is as stiff as 1 kHz allows, and knows none.
        kg, light = gripper["finger_mass_kg"] + drive_kg, min(gripper["finger_mass_kg"] / 0.05, 1.0)
        self.stiffness, self.damping, self.ahead_kg = (kg * 300.0**2, 2 * kg * 300.0, kg / 2) if is_real else (1e4 * light, 40 * light, 0.0)
        self.fastest, self.acceleration = (gripper["max_speed_mps"], gripper["max_acceleration_mps2"]) if is_real else (1e3, 1e6)
        # A real one takes moves and tells its state in cycles of its own.
        self.cycle_s, self.next_s = (1 / gripper["state_rate_hz"], phase_s) if is_real else (TICK_S, 0.0)
        self.latency_s = max(gripper["latency_s"] - self.cycle_s / 2, 0.0) if is_real else 0.0

    def forces(self, now_s: float, at_m: np.ndarray, speed_mps: np.ndarray) -> np.ndarray:
        width_m, rate_mps, is_cycle = at_m.sum(), speed_mps.sum(), now_s + 1e-9 >= self.next_s
        # What arrives after a cycle waits for the next one.
        while is_cycle and (move := self.queue.take_due(self.next_s, self.latency_s)) is not None:
            self.wanted_m = np.clip(move.width_m, 0.0, self.widest_m)
            if self.control == "two_state":
                self.wanted_m = self.widest_m if 2 * move.width_m > self.widest_m else 0.0
            obeys = self.control == "speed_and_force"
            self.speed_mps, self.force_n = (min(move.speed_mps, self.fastest), min(move.force_n, self.most_n)) if obeys else (self.fastest, self.most_n)
        opening = self.stiffness * (self.width_m - width_m) / 2 + self.damping * (self.rate_mps - rate_mps) / 2
        # The next set-point brakes in time, and waits for fingers that something keeps.
        way, before_mps, change = self.wanted_m - self.width_m, self.rate_mps, self.acceleration * TICK_S
        target = np.sign(way) * min(self.speed_mps, np.sqrt(2 * self.acceleration * abs(way)))
        self.rate_mps += np.clip(target - self.rate_mps, -change, change)
        self.width_m += (before_mps + self.rate_mps) / 2 * TICK_S
        if (self.wanted_m - self.width_m) * way <= 0:
            self.width_m, self.rate_mps = self.wanted_m, 0.0
        lead_m = 2 * self.force_n / self.stiffness
        if abs(self.width_m - width_m) > lead_m:
            self.width_m, self.rate_mps = np.clip(self.width_m, width_m - lead_m, width_m + lead_m), 0.0
        opening = np.clip(opening + self.ahead_kg * (self.rate_mps - before_mps) / TICK_S, -self.force_n, self.force_n)
        if is_cycle:
            self.next_s += self.cycle_s
            still = abs(rate_mps) < 5e-3
            grasp = ("holding" if opening < -0.9 * self.force_n else "idle") if still else "grasping" if rate_mps < 0 else "positioning"
            self.state = cb.GripperState(round(width_m, 5), round(rate_mps, 5), -opening, grasp)
        # The fingers are geared to each other.
        skew = self.stiffness * (at_m[0] - at_m[1]) / 2 + self.damping * (speed_mps[0] - speed_mps[1]) / 2
        return np.array([opening - skew, opening + skew])


class Images:
    """Depth by rays, with the noise of the scenario's cameras."""

    def __init__(self, setup: cb.Setup, drawn: dict, random: np.random.Generator) -> None:
        depth = setup.scenario["arena"]["depth"]
        self.random, self.labels, self.lost = random, setup.scenario["arena"]["labels"], depth["lost_frame_fraction"]
        self.noise = {} if depth["model"] == "perfect" else depth["model"]
        self.cameras, self.radius_m = setup.cameras, np.linalg.norm(setup.object["vertices"], axis=1).max()
        self.X_WC = [mjcf.matrix(it["position_m"], it["orientation_xyzw"]) for it in drawn["cameras"]]
        self.rays = [self.directions(it, X_WC[:3, :3]) for it, X_WC in zip(self.cameras, self.X_WC, strict=True)]

    def directions(self, camera: cb.Camera, R_WC: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors through the centres of all pixels in the world, and their parts along the optical axis."""
        u, v = np.meshgrid(*(np.arange(it) + 0.5 for it in camera.size_px))
        rays = np.linalg.solve(camera.K, np.stack([u, v, np.ones_like(u)]).reshape(3, -1))
        rays /= np.linalg.norm(rays, axis=0)
        return np.ascontiguousarray((R_WC @ rays).T).reshape(*u.shape, 3), rays[2].reshape(u.shape)

    def object_window(self, camera: int, p_WO: np.ndarray) -> tuple[int, int, int, int]:
        """The box around the object, which a sensor that tells objects apart tracks by itself."""
        it, X_WC = self.cameras[camera], self.X_WC[camera]
        p = X_WC[:3, :3].T @ (p_WO - X_WC[:3, 3])
        if p[2] <= self.radius_m:
            return 0, 0, 0, 0
        reach = 1.5 * self.radius_m * it.K[0, 0] / (p[2] - self.radius_m) + 2
        low, high = (np.clip((it.K @ p)[:2] / p[2] + way, 0, it.size_px).astype(int) for way in (-reach, reach))
        return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])

    def take(self, model, data, camera: int, now_s: float, window) -> cb.DepthFrame | None:
        if self.random.random() < self.lost:
            return None
        X_WC, (width, height) = self.X_WC[camera], self.cameras[camera].size_px
        if window is None:
            window = self.object_window(camera, data.body("object").xpos) if self.labels else (0, 0, width, height)
        left, top = window[:2]
        rays, along = (it[top : top + window[3], left : left + window[2]] for it in self.rays[camera])
        shape, count = along.shape, along.size
        geoms, far = np.full(count, -1, np.int32), np.zeros(count)
        if count > 0:
            seen = np.array([0, 1, 0, 0, 0, 0], np.uint8)
            mujoco.mj_multiRay(model, data, X_WC[:3, 3].copy(), rays.ravel(), seen, 1, -1, geoms, far, *NORMALS, count, 100.0)
        hit, depth = np.flatnonzero(geoms >= 0), np.full(count, np.nan, np.float32)
        depth[hit] = self.noisy(far[hit] * along.ravel()[hit], self.cameras[camera].K[0, 0])
        mask = (geoms == model.geom("surface").id).reshape(shape) if self.labels else None
        return cb.DepthFrame(camera, now_s, depth.reshape(shape), (left, top, shape[1], shape[0]), mask)

    def noisy(self, depth: np.ndarray, focal: float) -> np.ndarray:
        if stereo := self.noise.get("stereo"):
            sd, common = stereo["subpixel_px"] / (focal * stereo["baseline_m"]), stereo["common_fraction"]
            error = np.sqrt(common) * self.random.standard_normal() + np.sqrt(1 - common) * self.random.standard_normal(depth.shape)
            depth = 1 / np.maximum(1 / depth + sd * error, 1e-3)
            depth[self.random.random(depth.shape) < stereo["dropout_fraction"]] = np.nan
        return depth


class MujocoCell:
    """One throw. `sense` waits for the next images, `act` passes a command on."""

    def __init__(self, setup: cb.Setup, seed: int, index: int) -> None:
        drawn, arena, clock = setup.conditions(seed, index), setup.scenario["arena"], setup.scenario["clock"]
        self.setup, self.drawn, self.n, self.random = setup, drawn, setup.dof, np.random.default_rng([seed, index])
        is_real = arena["gripper"] == "real"
        self.model, self.nominal = mjcf.scene(setup, seed, index, drawn), mjcf.nominal(setup)
        self.data, self.believed = mujoco.MjData(self.model), mujoco.MjData(self.nominal)
        self.executor, self.images = cb.Executor(setup.robot, setup.gripper), Images(setup, drawn, self.random)
        self.fingers = Fingers(setup.gripper.numbers, is_real, drawn["gripper_phase_s"], self.model.dof_armature[self.n])
        self.gains, self.errors = arena["robot_controller"]["gains"], arena["robot_errors"]
        self.torque_limits = setup.limits[4]
        self.compute_s = 1e-3 * clock["fixed_ms"] if isinstance(clock, dict) else 0.0
        self.latency_s, self.period = arena["latency_s"], round(1 / (arena["frame_rate_hz"] * TICK_S))
        self.windows, self.commands, self.frames, self.ticks, self.has_sensed = None, [], [], 0, False
        names = [self.model.geom(i).name.split(":")[0] for i in range(self.model.ngeom)]
        self.part = np.array([PARTS.index(it) if it in PARTS else -1 for it in names])
        self.first_s, self.samples = np.full(len(PARTS), np.inf), []
        # The arm waits, and the object leaves the thrower's hand. The controller believes the fingers half open.
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self.believed.qpos[self.n : self.n + 2] = self.fingers.widest_m / 4
        mujoco.mj_forward(self.model, self.data)
        self.note(np.zeros(len(PARTS), bool))

    @property
    def time_s(self) -> float:
        return self.ticks * TICK_S

    def wait(self) -> None:
        """Time passes until the next images."""
        for _ in range(self.period if self.has_sensed else 0):
            self.tick()
        self.has_sensed = True

    def sense(self) -> cb.Observation:
        """What is sensed when the next images are due."""
        self.wait()
        now_s = self.time_s
        for camera in range(len(self.images.cameras)):
            window = None if self.windows is None else self.windows[camera]
            if (frame := self.images.take(self.model, self.data, camera, now_s, window)) is not None:
                self.frames.append((now_s + self.latency_s, frame))
        arrived = [frame for at_s, frame in self.frames if at_s <= now_s + 1e-9]
        self.frames = [it for it in self.frames if it[0] > now_s + 1e-9]
        return cb.Observation(now_s, self.executor.arm_state(now_s, *self.encoders()), self.fingers.state, arrived)

    def act(self, command: cb.Command) -> None:
        """It arrives after the time that it took to compute."""
        self.commands.append((self.time_s + self.compute_s, command))
        self.deliver()

    def deliver(self) -> None:
        while self.commands and self.commands[0][0] <= self.time_s + 1e-9:
            at_s, command = self.commands.pop(0)
            if command.trajectory is not None:
                # What it rejects the next arm state tells the brain.
                self.executor.receive(command.trajectory, at_s)
            if command.gripper is not None:
                self.fingers.queue.receive(command.gripper, at_s)
            self.windows = command.windows

    def encoders(self) -> tuple[np.ndarray, np.ndarray]:
        step = self.errors["encoder_step_rad"]
        q = self.data.qpos[: self.n] + self.errors["encoder_sd_rad"] * self.random.standard_normal(self.n)
        return np.round(q / step) * step if step > 0 else q, self.data.qvel[: self.n].copy()

    def torques(self) -> np.ndarray:
        """Computed torque, with the model that the controller has of the arm."""
        (q, dq), (wanted_q, wanted_dq, wanted_ddq) = self.encoders(), self.executor.advance(self.time_s)
        it, n, gains = self.believed, self.n, self.gains
        it.qpos[:n], it.qvel[:n] = q, dq
        it.qacc[:n] = wanted_ddq + gains["proportional_per_s2"] * (wanted_q - q) + gains["derivative_per_s"] * (wanted_dq - dq)
        mujoco.mj_inverse(self.nominal, it)
        return np.clip(it.qfrc_inverse[:n], -self.torque_limits, self.torque_limits)

    def air(self) -> np.ndarray:
        """Force of the air on the object."""
        it, drawn, R = self.data.joint("object"), self.drawn, self.data.body("object").xmat.reshape(3, 3)
        u = it.qvel[:3] - drawn["wind_mps"]
        drag = -drawn["drag_per_m"] * np.linalg.norm(u) * (u + R @ np.asarray(drawn["drag_deviation"]) @ R.T @ u)
        return drawn["mass_kg"] * (drag + drawn["magnus"] * np.cross(R @ it.qvel[3:], u))

    def tick(self) -> None:
        self.deliver()
        n, data, options = self.n, self.data, self.model.opt
        data.qfrc_applied[:n] = self.torques()
        data.qfrc_applied[n : n + 2] = self.fingers.forces(self.time_s, data.qpos[n : n + 2], data.qvel[n : n + 2])
        data.body("object").xfrc_applied[:3] = self.air()
        shaken_s = self.time_s - self.disturbed_s
        options.gravity[:] = [0, 0, -9.81] + (5 / np.sqrt(3) * np.sin(4 * np.pi * shaken_s) if shaken_s > 0 else 0) * np.ones(3)
        if self.time_s >= self.contact_s + 0.15:
            # What is held does not bounce: the same stiffness, critically damped.
            solref = self.model.pair_solref
            solref[:, 1] = -2 * np.sqrt(-solref[:, 0])
        # A tumbling object needs an integrator of higher order; contacts need none.
        is_far = np.linalg.norm(data.body("object").xpos - data.body("gripper").xpos) > 0.3
        options.integrator = mujoco.mjtIntegrator.mjINT_RK4 if is_far else mujoco.mjtIntegrator.mjINT_EULER
        touched, force = np.zeros(len(PARTS), bool), np.zeros(6)
        for _ in range(round(TICK_S / self.model.opt.timestep)):
            mujoco.mj_step(self.model, data)
            for i, contact in enumerate(data.contact):
                mujoco.mj_contactForce(self.model, data, i, force)
                if force[0] > 0:
                    touched[self.part[list(contact.geom)].max()] = True
        self.ticks += 1
        mujoco.mj_kinematics(self.model, data)
        self.note(touched)

    def note(self, touched: np.ndarray) -> None:
        self.first_s[touched & np.isinf(self.first_s)] = self.time_s
        X = [np.r_[np.c_[it.xmat.reshape(3, 3), it.xpos], [[0, 0, 0, 1]]] for it in map(self.data.body, ["gripper", "object"])]
        width_m = self.data.qpos[self.n : self.n + 2].sum()
        self.samples.append((self.time_s, *X, width_m, self.fingers.wanted_m, self.data.qvel[: self.n].copy(), touched.astype(float)))

    @property
    def contact_s(self) -> float:
        """When the gripper first touched the object; a second later the world begins to shake."""
        return self.first_s[:3].min()

    @property
    def disturbed_s(self) -> float:
        return self.contact_s + 1.0

    @property
    def done(self) -> bool:
        """Whether the referee has seen enough: as in the arena."""
        ends_s = self.disturbed_s + 0.5 if np.isfinite(self.contact_s) else min(min(self.first_s[3], self.first_s[5]) + 1.0, 5.0)
        return self.time_s > max(min(ends_s, self.first_s[4] + 0.2), 0.875) - 1e-9

    def why_not_caught(self) -> str | None:
        fields = ["time_s", "X_WG", "X_WO", "width_m", "commanded_width_m", "dq", "contacts"]
        samples = {name: np.array(values) for name, values in zip(fields, zip(*self.samples), strict=True)}
        return cb.judge(samples, self.disturbed_s if np.isfinite(self.disturbed_s) else None)
