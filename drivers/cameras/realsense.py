"""Sends the depth images of all RealSense cameras that are connected: python realsense.py SOCKET SERIAL...

The order of the serial numbers is that of the cameras in the rig's file. Needs pyrealsense2. Not tried with a camera.
"""

import sys
import time

import numpy as np
import pyrealsense2 as rs
from sender import Sender

sender, pipelines = Sender(sys.argv[1]), []
for serial in sys.argv[2:]:
    config = rs.config()
    config.enable_device(serial)
    config.enable_stream(rs.stream.depth, 848, 480, rs.format.z16, 90)
    pipelines.append(rs.pipeline())
    scale = pipelines[-1].start(config).get_device().first_depth_sensor().get_depth_scale()
    assert abs(scale - 0.001) < 1e-6, f"camera {serial}: found a depth unit of {scale} m, expected 0.001"
# Global time stamps are those of the system's clock, in milliseconds.
offset_s = time.monotonic() - time.time()
while True:
    for camera, pipeline in enumerate(pipelines):
        arrived, frames = pipeline.try_wait_for_frames(1)
        if arrived:
            frame = frames.get_depth_frame()
            sender.send(camera, frame.get_timestamp() / 1000 + offset_s, np.asanyarray(frame.get_data()))
