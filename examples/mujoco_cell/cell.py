"""A cell in MuJoCo: it senses and acts as a real one would, and knows what really happened.

`run.py` throws in it. `model.py` has the scene, and `devices.py` the gripper and the cameras.
"""

import catchingbot as cb
import mujoco
import numpy as np
import model as mjcf
from devices import TICK_S, Fingers, Images

# What can touch the object, in the order in which the referee asks for it.
PARTS = ["left", "right", "palm", "arm", "floor", "obstacle"]


class MujocoCell:
    """One throw. `sense` waits for the next images, `act` passes a command on."""

    def __init__(self, setup: cb.Setup, seed: int, index: int) -> None:
        # The arm and the object as they are, and the arm as its controller believes it to be.
        self.setup, self.drawn, self.n = setup, setup.conditions(seed, index), setup.dof
        self.model, self.nominal = mjcf.scene(setup, seed, index, self.drawn), mjcf.nominal(setup)
        self.data, self.believed = mujoco.MjData(self.model), mujoco.MjData(self.nominal)
        # Devices and their errors. What the scenario's clock calls computing is the time from images to a command.
        arena, clock, self.random = setup.scenario["arena"], setup.scenario["clock"], np.random.default_rng([seed, index])
        self.executor, self.images = cb.Executor(setup.robot, setup.gripper), Images(setup, self.drawn["cameras"], self.random)
        drive_kg, phase_s = self.model.dof_armature[self.n], self.drawn["gripper_phase_s"]
        self.fingers = Fingers(setup.gripper.numbers, setup.waiting_width_m, arena["gripper"] == "real", phase_s, drive_kg)
        self.gains, self.errors, self.torque_limits = arena["robot_controller"]["gains"], arena["robot_errors"], setup.limits[4]
        self.compute_s, self.latency_s = 1e-3 * clock["fixed_ms"] if isinstance(clock, dict) else 0.0, arena["latency_s"]
        # What is under way: windows that the brain wants to see, commands and images with their times of arrival.
        self.windows, self.commands, self.frames = None, [], []
        self.period, self.ticks, self.has_sensed = round(1 / (arena["frame_rate_hz"] * TICK_S)), 0, False
        # What the referee wants to know.
        names = [self.model.geom(i).name.split(":")[0] for i in range(self.model.ngeom)]
        self.part = np.array([PARTS.index(it) if it in PARTS else -1 for it in names])
        self.first_s, self.samples, self.contact_s, self.disturbed_s = np.full(len(PARTS), np.inf), [], np.inf, np.inf
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
        for camera, window in enumerate(self.windows or [None] * len(self.images.cameras)):
            if (frame := self.images.take(self.model, self.data, camera, now_s, window)) is not None:
                self.frames.append((now_s + self.latency_s, frame))
        arrived = [frame for at_s, frame in self.frames if at_s <= now_s + 1e-9]
        self.frames = self.frames[len(arrived) :]
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
        """A cycle of the controllers, and what becomes of it."""
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
        for _ in range(round(TICK_S / options.timestep)):
            mujoco.mj_step(self.model, data)
            for i, contact in enumerate(data.contact):
                mujoco.mj_contactForce(self.model, data, i, force)
                if force[0] > 0:
                    touched[self.part[list(contact.geom)].max()] = True
        self.ticks += 1
        mujoco.mj_kinematics(self.model, data)
        self.note(touched)

    def note(self, touched: np.ndarray) -> None:
        """Takes down the truth, for the referee."""
        self.first_s[touched & np.isinf(self.first_s)] = self.time_s
        # A second after the gripper touches the object the world begins to shake.
        self.contact_s = self.first_s[:3].min()
        self.disturbed_s = self.contact_s + 1.0
        X = [np.r_[np.c_[it.xmat.reshape(3, 3), it.xpos], [[0, 0, 0, 1]]] for it in map(self.data.body, ["gripper", "object"])]
        width_m = self.data.qpos[self.n : self.n + 2].sum()
        self.samples.append((self.time_s, *X, width_m, self.fingers.wanted_m, self.data.qvel[: self.n].copy(), touched.astype(float)))

    @property
    def done(self) -> bool:
        """Whether the referee has seen enough: as in the arena."""
        ends_s = self.disturbed_s + 0.5 if np.isfinite(self.contact_s) else min(min(self.first_s[3], self.first_s[5]) + 1.0, 5.0)
        return self.time_s > max(min(ends_s, self.first_s[4] + 0.2), 0.875) - 1e-9

    def why_not_caught(self) -> str | None:
        fields = ["time_s", "X_WG", "X_WO", "width_m", "commanded_width_m", "dq", "contacts"]
        samples = {name: np.array(values) for name, values in zip(fields, zip(*self.samples), strict=True)}
        return cb.judge(samples, self.disturbed_s if np.isfinite(self.disturbed_s) else None)
