"""A recorded throw for the viewer Rerun: the moving arm with its surfaces, the paths, the depth images.

>>> import catchingbot.rerun
>>> catchingbot.rerun.write("out/honest-tennis_ball-random-1-0.catch", "throw.rrd")

``rerun throw.rrd`` opens it. Needs ``pip install catchingbot[rerun]``; ``python -m catchingbot.rerun RECORDING OUT`` does the same.
"""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from catchingbot._catchingbot import viewed

TIMELINE = "throw"
_BLUE, _ORANGE, _GREY = (28, 109, 208), (217, 72, 15), (92, 99, 107)


def write(recording: str | os.PathLike[str], out: str | os.PathLike[str]) -> None:
    """Writes the file of a recorded throw, with the views that it opens with."""
    seen = viewed(recording)
    stream = rr.RecordingStream("catchingbot", recording_id=f"{seen['title']}")
    stream.save(os.fspath(out), default_blueprint=_blueprint(seen))
    _bodies(stream, seen)
    _paths(stream, seen)
    _images(stream, seen)
    for time_s, text in seen["story"]:
        stream.set_time(TIMELINE, duration=time_s)
        stream.log("story", rr.TextLog(text))
    stream.disconnect()


def _used(seen: dict[str, Any]) -> list[int]:
    """The cameras that took images."""
    return sorted({camera for camera, *_ in seen["images"]})


def _blueprint(seen: dict[str, Any]) -> rrb.Blueprint:
    images = [rrb.Spatial2DView(origin=f"world/camera_{i:02}", name=f"camera {i}") for i in _used(seen)[:4]]
    base = seen["poses"]["link_0"][0, :3, 3]
    target = base + [0.0, 0.0, 0.6]
    scene = rrb.Spatial3DView(
        origin="world",
        name="throw",
        contents=["+ $origin/**", *(f"- $origin/camera_{i:02}/depth" for i in _used(seen))],
        line_grid=rrb.LineGrid3D(visible=True),
        eye_controls=rrb.EyeControls3D(position=target + [1.9, 1.6, 0.7], look_target=target, eye_up=[0.0, 0.0, 1.0]),
    )
    rows = [rrb.Horizontal(*images)] if images else []
    rows.append(rrb.TextLogView(origin="story", name="story"))
    time = rrb.TimePanel(timeline=TIMELINE, playback_speed=0.3, loop_mode="all", play_state="playing", state="collapsed")
    return rrb.Blueprint(rrb.Vertical(scene, *rows, row_shares=[4, *[1] * len(rows)]), time, collapse_panels=True)


def _bodies(stream: rr.RecordingStream, seen: dict[str, Any]) -> None:
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for i, (frames, vertices, triangles, colour) in enumerate(seen["surfaces"]):
        mesh = rr.Mesh3D(
            vertex_positions=vertices[triangles].reshape(-1, 3),
            vertex_normals=_normals(vertices, triangles),
            albedo_factor=[*colour, 1.0],
        )
        for frame in frames:
            stream.log(f"world/{frame}/surface_{i:02}", mesh, static=True)
    times = rr.TimeColumn(TIMELINE, duration=seen["time_s"])
    for frame, poses in seen["poses"].items():
        columns = rr.Transform3D.columns(translation=poses[:, :3, 3], mat3x3=poses[:, :3, :3])
        stream.send_columns(f"world/{frame}", [times], columns)


def _normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """A normal for each corner of each triangle: smooth across faces that meet at less than 40 degrees."""
    corners = vertices[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    units = faces / (np.linalg.norm(faces, axis=1, keepdims=True) + 1e-12)
    normals = np.empty((triangles.size, 3))
    order = np.argsort(triangles.ravel(), kind="stable")
    for around in np.split(order, np.cumsum(np.bincount(triangles.ravel()))[:-1]):
        near = around // 3
        normals[around] = (units[near] @ units[near].T > 0.77) @ faces[near]
    return normals / (np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12)


def _paths(stream: rr.RecordingStream, seen: dict[str, Any]) -> None:
    """What was flown and moved until each time, and what was predicted then."""
    for frame, colour in [("object", _ORANGE), ("hand", _GREY)]:
        if (poses := seen["poses"].get(frame)) is None:
            continue
        for i in range(1, len(poses), 4):
            stream.set_time(TIMELINE, duration=seen["time_s"][i])
            stream.log(f"world/path_of_{frame}", rr.LineStrips3D([poses[: i + 1 : 2, :3, 3]], colors=[colour], radii=0.003))
    for time_s, points in seen["predictions"]:
        stream.set_time(TIMELINE, duration=time_s)
        stream.log("world/predicted", rr.LineStrips3D([points], colors=[_BLUE], radii=0.003))


def _images(stream: rr.RecordingStream, seen: dict[str, Any]) -> None:
    for i in _used(seen):
        X = seen["cameras"][i].X_WC
        stream.log(f"world/camera_{i:02}", rr.Transform3D(translation=X[:3, 3], mat3x3=X[:3, :3]), static=True)
    for i, time_s, (left, top), depth in seen["images"]:
        # A part of the image was read out: its principal point moves along.
        K = seen["cameras"][i].K.copy()
        K[:2, 2] -= (left, top)
        stream.set_time(TIMELINE, duration=time_s)
        stream.log(f"world/camera_{i:02}", rr.Pinhole(image_from_camera=K, resolution=depth.shape[::-1], image_plane_distance=0.2))
        stream.log(f"world/camera_{i:02}/depth", rr.DepthImage(np.where(np.isfinite(depth), depth, 0.0), meter=1.0))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("expected two arguments: a recording (*.catch) and the file to write (*.rrd)")
    write(*sys.argv[1:])
