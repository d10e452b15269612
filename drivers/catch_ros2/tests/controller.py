"""A joint_trajectory_controller, as its documentation says, on a real rclpy node.

    python controller.py NAME JOINTS POSITIONS LOG

It takes trajectories from NAME/joint_trajectory and publishes joint states beside it. A trajectory with a zero stamp starts as it
arrives and replaces the one before; until its first point, and from one point to the next, positions are interpolated by a polynomial of
fifth degree. It prints "ready" once it spins, and appends its set-points to the file LOG: a line for each millisecond, which is the time and
the positions.
"""

import sys
import time

import numpy as np
import rclpy
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

STATES_S = 0.01
STEP_S = 0.001


class Controller:
    def __init__(self, node, name, joints, positions, log):
        self.joints, self.log = joints, open(log, "a")
        zeros = np.zeros(len(joints))
        self.points, self.now_s = [(0.0, np.array(positions), zeros, zeros)], 0.0
        self.began_s = time.monotonic()
        node.create_subscription(JointTrajectory, f"{name}/joint_trajectory", self.take, 10)
        self.states = node.create_publisher(JointState, f"{name.rpartition('/')[0]}/joint_states", 10)
        node.create_timer(STATES_S, self.tell)

    def setpoint(self, time_s):
        """Position, velocity and acceleration."""
        after = next((i for i, it in enumerate(self.points) if time_s < it[0]), None)
        if after is None:
            _, q, dq, ddq = self.points[-1]
            return q, dq, ddq
        (start_s, p, v, a), (end_s, q, w, b) = self.points[after - 1 : after + 1]
        whole, t = end_s - start_s, time_s - start_s
        ends = np.array([q - p - v * whole - a * whole**2 / 2, w - v - a * whole, b - a])
        high = np.linalg.solve([[n * whole**k for n, k in row] for row in POWERS], ends)
        factors = [p, v, a / 2, *high]
        derivative = lambda order: sum(c * np.prod(range(i - order + 1, i + 1)) * t ** (i - order) for i, c in enumerate(factors) if i >= order)
        return derivative(0), derivative(1), derivative(2)

    def run_until(self, time_s):
        while self.now_s + STEP_S <= time_s:
            self.now_s += STEP_S
            print(f"{self.now_s:.3f}", *self.setpoint(self.now_s)[0], file=self.log)
        self.log.flush()

    def take(self, message):
        self.run_until(time.monotonic() - self.began_s)
        assert message.header.stamp.sec == message.header.stamp.nanosec == 0, "the stamp is zero"
        assert list(message.joint_names) == self.joints, message.joint_names
        start_s, points = self.now_s, [(self.now_s, *self.setpoint(self.now_s))]
        for it in message.points:
            at_s = start_s + it.time_from_start.sec + 1e-9 * it.time_from_start.nanosec
            points.append((at_s, *(np.array(values) for values in (it.positions, it.velocities, it.accelerations))))
        assert all(one[0] < other[0] for one, other in zip(points, points[1:], strict=False)), "times rise"
        assert not np.any(points[-1][2]) and not np.any(points[-1][3]), "it ends at rest"
        self.points = points
        print(f"{len(message.points)} points", flush=True)

    def tell(self):
        self.run_until(time.monotonic() - self.began_s)
        q, dq, _ = self.setpoint(self.now_s)
        # Joint states may have any order, and more joints.
        message = JointState(name=["finger", *reversed(self.joints)], position=[0.0, *q[::-1]], velocity=[0.0, *dq[::-1]])
        self.states.publish(message)


# Factors and powers of the three highest terms in position, velocity and acceleration.
POWERS = [[(1, 3), (1, 4), (1, 5)], [(3, 2), (4, 3), (5, 4)], [(6, 1), (12, 2), (20, 3)]]
name, joints, positions, log = sys.argv[1:]
rclpy.init()
node = rclpy.create_node("controller")
controller = Controller(node, name, joints.split(","), [float(it) for it in positions.split(",")], log)
print("ready", flush=True)
rclpy.spin(node)
