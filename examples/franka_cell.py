"""A Franka FR3 as a cell in Python: `python franka_cell.py ADDRESS`.

The robot wants an answer within each millisecond. A process of its own gives it with pylibfranka; the brain's process checks trajectories
and sends them there. The example moves the first joint by 0.1 rad and back while it computes, and prints how long answers took. A thread in
the brain's process would wait for Python's lock.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time

import numpy as np
import pylibfranka

import catchingbot as cb

TICK_S, HANDOVER_S = 0.01, 0.005
PARTS = "fr3", "franka_hand"


def answer(address: str, pipe) -> None:
    """Holds the arm, executes trajectories from the pipe until None comes, and sends each tenth state back."""
    robot = pylibfranka.Robot(address, pylibfranka.RealtimeConfig.kIgnore)
    control = robot.start_joint_position_control(pylibfranka.ControllerMode.JointImpedance)
    executor, origin_s, took_s, is_over = None, 0.0, [], False
    while not is_over:
        state, _ = control.readOnce()
        began_s = time.perf_counter()
        if executor is None:
            origin_s = state.time.to_sec()
            executor = cb.Executor(cb.Robot(PARTS[0]), cb.Gripper(PARTS[1]), state.q_d)
        now_s = state.time.to_sec() - origin_s
        if pipe.poll():
            trajectory = pipe.recv()
            is_over = trajectory is None
            if not is_over and (why := executor.receive(trajectory, now_s)):
                print(f"{now_s:.3f} s: {why}")
        command = pylibfranka.JointPositions(executor.advance(now_s + 0.001)[0].tolist())
        command.motion_finished = is_over
        control.writeOnce(command)
        if len(took_s) % 10 == 0 and not is_over:
            pipe.send((now_s, state.q, state.dq))
        took_s.append(time.perf_counter() - began_s)
    pipe.send(took_s)


class FrankaCell:
    """`sense` waits for the next hundredth of a second, `act` passes a trajectory on. Images come from the function `frames`."""

    def __init__(self, address: str, frames=lambda time_s: []) -> None:
        self.pipe, other = multiprocessing.Pipe()
        multiprocessing.get_context("spawn").Process(target=answer, args=(address, other), daemon=True).start()
        # So that the end of the process ends the pipe.
        other.close()
        self.time_s, self.q, self.dq = self.pipe.recv()
        self.executor, self.frames = cb.Executor(cb.Robot(PARTS[0]), cb.Gripper(PARTS[1]), self.q), frames

    def sense(self) -> cb.Observation:
        until_s = self.time_s + TICK_S
        while self.time_s < until_s or self.pipe.poll():
            self.time_s, self.q, self.dq = self.pipe.recv()
        self.executor.advance(self.time_s)
        arm = self.executor.arm_state(self.time_s, self.q, self.dq)
        # The hand has a protocol of its own: pylibfranka.Gripper.
        return cb.Observation(self.time_s, arm, cb.GripperState(0.0), self.frames(self.time_s))

    def act(self, command: cb.Command) -> None:
        if command.trajectory is not None and self.executor.receive(command.trajectory, self.time_s + HANDOVER_S) is None:
            self.pipe.send(command.trajectory)

    def stop(self) -> list[float]:
        """Ends the motion. The arm has to rest. Returns how long answers took, in seconds."""
        self.pipe.send(None)
        while not isinstance(last := self.pipe.recv(), list):
            pass
        return last


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("address")
    asked = parser.parse_args()
    cell = FrankaCell(asked.address)
    ways_rad, free_s = [0.1, -0.1], 0.0
    knots_s = np.repeat([0.0, 0.5, 1.0, 1.5], [4, 1, 1, 4])
    while cell.time_s < 4.0:
        seen, command = cell.sense(), cb.Command()
        if ways_rad and seen.time_s >= free_s:
            begins_s, from_q = seen.time_s + 0.05, np.array(cell.executor.advance(seen.time_s)[0])
            to_q = from_q + ways_rad.pop(0) * np.eye(len(from_q))[0]
            command = cb.Command(cb.Trajectory(2 - len(ways_rad), knots_s + begins_s, [from_q] * 3 + [to_q] * 3))
            free_s = begins_s + 1.6
        cell.act(command)
        # A brain computes here. This one holds Python's lock for some milliseconds.
        sum(range(200_000))
    took_ms = 1e3 * np.array(cell.stop())
    figures = ", ".join(f"{name} {np.quantile(took_ms, it):.3f}" for name, it in [("median", 0.5), ("99 %", 0.99), ("99.9 %", 0.999), ("most", 1.0)])
    print(f"{len(took_ms)} answers in ms: {figures}")


if __name__ == "__main__":
    main()
