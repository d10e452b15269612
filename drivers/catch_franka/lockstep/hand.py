"""The Franka Hand's protocol (libfranka, version 3), answered by fingers that somebody else moves.

What libfranka documents is kept: one answer for each command when it has ended, `grasp` closes until something
stops the fingers and compares the width then, `stop` ends what runs. Not documented, and assumed here: a command
ends the one that runs. Latency, speed, force and rate of the states are those of the fingers.
"""

import socket

import catchingbot as cb
from franka_sim.gripper import protocol
from franka_sim.gripper.protocol import GripperCommand, GripperStatus
from protocol import Alive

# Time after which fingers that stand have ended their move: the latency and two cycles.
SETTLED_S = 0.06
# Speed in m/s below which they stand, and the least of a move's distances that counts as reached.
STILL_MPS = 5e-3
REACHED_M = 2e-3


class Hand:
    def __init__(self, port, fingers, state_rate_hz):
        self.fingers, self.interval_s = fingers, 1 / state_rate_hz
        self.listener = socket.create_server(("127.0.0.1", port))
        self.listener.setblocking(False)
        self.states = Alive(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        self.client, self.udp, self.bytes = None, None, b""
        self.running, self.is_grasped, self.next_s, self.sent = None, False, 0.0, 0

    def poll(self, now_s, fingers_s):
        """Takes what has come, and sends what is due on the client's clock. The fingers have one of their own."""
        if self.client is None:
            try:
                self.client, _ = self.listener.accept()
            except BlockingIOError:
                return
            self.client.setblocking(False)
        try:
            self.bytes += self.client.recv(4096)
        except BlockingIOError:
            pass
        size = protocol.GRIPPER_HEADER_SIZE
        while len(self.bytes) >= size and len(self.bytes) >= (header := protocol.GripperCommandHeader.from_bytes(self.bytes)).size:
            payload, self.bytes = self.bytes[size : header.size], self.bytes[header.size :]
            self.begin(header, payload, fingers_s)
        self.end(fingers_s)
        if self.udp and now_s >= self.next_s:
            self.next_s, self.sent = max(self.next_s + self.interval_s, now_s), self.sent + 1
            state = protocol.GripperState(self.fingers.state.width_m, self.fingers.widest_m, self.is_grasped, 30)
            self.states.sendto(state.pack(self.sent), self.udp)

    def answer(self, header, status):
        self.client.sendall(protocol.build_command_response(header.command, header.command_id, status))

    def begin(self, header, payload, now_s):
        if header.command == GripperCommand.kConnect:
            asked = protocol.ConnectRequest.from_bytes(payload)
            self.udp = (self.client.getpeername()[0], asked.udp_port)
            status = protocol.GripperConnectStatus.kSuccess
            self.client.sendall(protocol.build_connect_response(header.command_id, status, protocol.GRIPPER_VERSION))
            return
        if self.running is not None:
            self.answer(self.running[0], GripperStatus.kAborted)
            self.running = None
        width_m, speed_mps, force_n, asked = self.fingers.state.width_m, 1.0, self.fingers.most_n, None
        if header.command == GripperCommand.kMove:
            asked = protocol.MoveRequest.from_bytes(payload)
            width_m, speed_mps = asked.width, asked.speed
        elif header.command == GripperCommand.kGrasp:
            asked = protocol.GraspRequest.from_bytes(payload)
            width_m, speed_mps, force_n = 0.0, asked.speed, asked.force
        elif header.command == GripperCommand.kHoming:
            width_m = self.fingers.widest_m
        if not (0 <= width_m <= self.fingers.widest_m and speed_mps > 0 and force_n > 0):
            self.answer(header, GripperStatus.kFail)
            return
        # The protocol's speed is that of one finger.
        self.fingers.queue.receive([cb.GripperMove(now_s, width_m, 2 * speed_mps, force_n)], now_s)
        self.running, self.is_grasped = (header, asked, width_m, now_s), False

    def end(self, now_s):
        if self.running is None or now_s < self.running[3] + SETTLED_S or abs(self.fingers.state.speed_mps) > STILL_MPS:
            return
        header, asked, wanted_m, _ = self.running
        width_m, self.running = self.fingers.state.width_m, None
        is_good = abs(width_m - wanted_m) < REACHED_M
        if header.command == GripperCommand.kGrasp:
            is_good = self.is_grasped = asked.width - asked.epsilon_inner < width_m < asked.width + asked.epsilon_outer
        self.answer(header, GripperStatus.kSuccess if is_good or header.command == GripperCommand.kStop else GripperStatus.kUnsuccessful)
