"""A throw in MuJoCo behind the protocols of arm, hand and cameras, in lock-step with the driver.

    python throw.py RECORDING ARM_PORT HAND_PORT SOCKET

RECORDING is a throw of the arena: the same is thrown here. The object, the images and the fingers are those of
examples/mujoco_cell; the servo of franka-sim moves the arm, in the same model. It prints "ready" once it listens,
and in the end one line of JSON: whether the object was caught in the arena, and here. Its clock stands until the arm is controlled.
"""

import fcntl
import json
import pathlib
import struct
import sys
import termios
import time

import mujoco
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path += [str(HERE.parents[1] / "cameras"), str(HERE.parents[2] / "examples/mujoco_cell")]

import catchingbot as cb
from cell import TICK_S, MujocoCell
from hand import Hand
from protocol import Arm, Server
from sender import Sender

# Reflected inertia of the rotors in kg m2: the position servo of franka-sim oscillates on joints 1 and 3 with
# the 0.1 of robot.toml.
ARMATURE_KGM2 = 0.195
# Time before the throw in seconds, and where the object is until then: farther than the cameras see.
BEFORE_S = 0.2
FAR_M = [0.0, 0.0, 1000.0]
# Shortest duration of a cycle, and time for an image to reach the brain, in seconds of the machine's clock: it
# has threads that wait for no lock-step.
CYCLE_S = 1e-3
IMAGE_S = 3e-3


class Throw(MujocoCell):
    def __init__(self, recording, hand_port, socket):
        super().__init__(recording.setup, recording.seed, recording.index)
        self.samples, self.ticks, self.robot_s = [], -round(BEFORE_S / TICK_S), 0.0
        self.released = self.model.key_qpos[0][self.n + 2 :], self.model.key_qvel[0][self.n + 2 :]
        self.model.dof_armature[: self.n] = ARMATURE_KGM2
        self.hand = Hand(hand_port, self.fingers, self.setup.gripper.numbers["state_rate_hz"])
        self.arena = recording.reason or "caught"
        self.socket, self.sender, self.servo, self.reason = socket, None, None, ""

    def torques(self):
        """Those of the servo, and the weight by the model that the controller has of the arm."""
        it, n = self.believed, self.n
        it.qpos[:n], it.qvel[:n], it.qacc[:n] = self.data.qpos[:n], 0, 0
        mujoco.mj_inverse(self.nominal, it)
        return self.servo() + it.qfrc_inverse[:n]

    def note(self, touched):
        if self.ticks > 0:
            super().note(touched)

    def cycle(self):
        """One step, and what is due at its end."""
        position, velocity = self.released
        if self.ticks <= 0:
            self.data.qpos[self.n + 2 :], self.data.qvel[self.n + 2 :] = (position, velocity) if self.ticks == 0 else ([*FAR_M, 1, 0, 0, 0], 0)
        self.tick()
        if self.done and not self.reason:
            self.reason = self.why_not_caught() or "caught"
            print(json.dumps([self.arena, self.reason]), flush=True)
        if not self.reason:
            self.send_images()
        time.sleep(CYCLE_S)

    def send_images(self):
        if self.sender is None:
            self.sender = Sender(self.socket)
        for camera in range(len(self.images.cameras) if self.ticks % self.period == 0 else 0):
            window = (0, 0, *self.images.cameras[camera].size_px)
            self.frames.append((self.robot_s + self.latency_s, self.robot_s, camera, self.images.take(self.model, self.data, camera, self.time_s, window)))
        while self.frames and self.frames[0][0] <= self.robot_s + 1e-9:
            _, capture_s, camera, frame = self.frames.pop(0)
            if frame is None:
                self.sender.numbers[camera] = self.sender.numbers.get(camera, -1) + 1
                continue
            self.sender.send(camera, capture_s, np.nan_to_num(frame.depth_m))
            while struct.unpack("i", fcntl.ioctl(self.sender.socket, termios.TIOCOUTQ, b"\0" * 4))[0]:
                time.sleep(1e-4)
            time.sleep(IMAGE_S)


class SceneArm(Arm):
    """The arm of the scene, moved by the servo of franka-sim."""

    def __init__(self, throw):
        super().__init__()
        self.model, self.data, self.prefix = throw.model, throw.data, "arm/fr3_"
        self.throw, throw.servo = throw, self.arm_control_torque

    def initialize_simulation(self):
        self._bind_model()
        self.latest_joint_positions = self.data.qpos[self.arm_qpos_adr].copy()
        self._position_feedforward.reset(self.latest_joint_positions)
        self._read_and_publish_state()

    def step(self):
        self.throw.cycle()
        self._read_and_publish_state()


class SceneServer(Server):
    """Physics goes on while the arm is controlled; the hand is always there."""

    def _account_for_communication_cycle(self):
        throw = self.physics_sim.throw
        throw.robot_s = self.robot_state.state["message_id"] * 1e-3
        if self.comm.active:
            super()._account_for_communication_cycle()
        else:
            super(Server, self)._account_for_communication_cycle()
        throw.hand.poll(throw.robot_s, throw.time_s)


recording, arm_port, hand_port, socket = sys.argv[1:]
throw = Throw(cb.Recording(recording), int(hand_port), socket)
SceneServer(SceneArm(throw), int(arm_port)).start()
