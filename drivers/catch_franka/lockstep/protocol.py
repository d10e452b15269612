"""The server of franka-sim in lock-step with its client: each answered state is one step of physics."""

import threading
import time

from franka_sim.franka_sim_server import FrankaSimServer
from franka_sim.mujoco_franka_sim import MujocoFrankaSim

# Longest wait for an answer, in seconds: whoever takes longer is dead.
PATIENCE_S = 60.0
# Time in seconds after which a state is repeated: clients take a device for dead that tells nothing for a second.
REPEAT_S = 0.3


class Arm(MujocoFrankaSim):
    def run_simulation(self):
        """Steps come from the server's cycles."""
        while self.running:
            time.sleep(0.05)


class Alive:
    """A socket of states. As long as the next one takes, the last is repeated: clients forget a number that they know."""

    def __init__(self, socket):
        self.socket, self.last, self.sent_s = socket, None, 0.0
        threading.Thread(target=self.repeat, daemon=True).start()

    def __getattr__(self, name):
        return getattr(self.socket, name)

    def sendto(self, data, address):
        self.last, self.sent_s = (data, address), time.monotonic()
        return self.socket.sendto(data, address)

    def repeat(self):
        while self.socket.fileno() >= 0:
            time.sleep(REPEAT_S / 3)
            if self.last and time.monotonic() > self.sent_s + REPEAT_S:
                try:
                    self.socket.sendto(*self.last)
                except OSError:
                    return


class Lossy(Alive):
    """The socket of states and commands. Of `lose` commands `together` are lost: read and forgotten. Or, once, the link holds
    `late` of them after so many, and lets them through with the next one, in order."""

    def __init__(self, socket, lose, together, late):
        self.lose, self.together, self.late = lose, together, late
        self.count, self.lost, self.held, self.again = 0, False, [], []
        super().__init__(socket)

    def recvfrom(self, size):
        data, address = self.socket.recvfrom(size)
        if data in self.again:
            self.again.remove(data)
            return data, address
        self.count += 1
        if self.held and self.count >= self.lose + self.late:
            self.again, self.held = [*self.held, data], []
            for it in self.again:
                self.socket.sendto(it, ("127.0.0.1", self.socket.getsockname()[1]))
            raise BlockingIOError
        if self.late:
            self.lost = self.lose <= self.count < self.lose + self.late
            self.held += [data] if self.lost else []
        elif self.lose:
            self.lost = self.count % self.lose < self.together and self.count >= self.lose
        if self.lost:
            raise BlockingIOError
        return data, address


class Server(FrankaSimServer):
    """It prints "ready" once it listens. Motion limits and communication constraints are enforced."""

    def __init__(self, arm, port, lose=0, together=1, late=0):
        super().__init__(host="127.0.0.1", port=port, physics_sim=arm, enable_gripper=False,
                         enforce_comm_constraints=True, enforce_motion_limits=True)
        self.losses = lose, together, late

    def _bind_listener(self):
        super()._bind_listener()
        print("ready", flush=True)

    def start_command_receiver(self):
        self.udp_socket = Lossy(self.udp_socket, *self.losses)
        super().start_command_receiver()

    def _drain_gate(self, answer_deadline=0.0):
        """Waits for the answer, however long the client's machine is busy, but for a dead client."""
        began = time.perf_counter()
        while self.comm.awaiting_answer and self.connection_running and time.perf_counter() < began + PATIENCE_S:
            if self.udp_socket.lost:
                break
            time.sleep(2e-5)
        while (self._commands_in_flight or self.udp_socket.again) and time.perf_counter() < began + PATIENCE_S:
            time.sleep(2e-5)
        self.udp_socket.lost = False
        return time.perf_counter() - began

    def _account_for_communication_cycle(self):
        """The state that goes out is that after the step which the answer asked for."""
        super()._account_for_communication_cycle()
        self.physics_sim.step()
        state = self.physics_sim.get_robot_state()
        own = self._server_owned_state_fields
        self.robot_state.state.update({field: value for field, value in state.items() if field not in own})
