"""Sends depth images to the driver of a real cell over its Unix socket.

    from sender import Sender
    sender = Sender("/tmp/catchingbot-cameras")
    sender.send(camera, capture_s, depth)

`camera` is the number in the rig, `capture_s` the time of capture on the clock of time.monotonic(), `depth` an array of
height x width: uint16 in millimetres or float32 in metres, zero where there is no depth.
"""

import socket
import struct

import numpy as np

FORMATS = {np.dtype("<u2"): 1, np.dtype("<f4"): 2}


class Sender:
    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.connect(str(path))
        self.numbers = {}

    def send(self, camera, capture_s, depth):
        depth = np.ascontiguousarray(depth)
        if depth.ndim != 2 or depth.dtype not in FORMATS:
            raise ValueError(f"depth: found {depth.dtype} of shape {depth.shape}, expected uint16 or float32, height x width")
        number = self.numbers[camera] = self.numbers.get(camera, -1) + 1
        height, width = depth.shape
        header = struct.pack("<4sIIdIIII", b"CBD1", camera, number, capture_s, width, height, FORMATS[depth.dtype], depth.nbytes)
        self.socket.sendall(header + depth.tobytes())
