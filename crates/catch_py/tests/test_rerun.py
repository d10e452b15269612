"""Files for Rerun: they load, and hold the moving arm, the paths, the images and the story."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("rerun")

import catchingbot as cb  # noqa: E402
import catchingbot.rerun  # noqa: E402
from catchingbot._catchingbot import viewed  # noqa: E402


def test_a_throw_is_written_whole(tmp_path):
    recording, out = tmp_path / "throw.catch", tmp_path / "throw.rrd"
    recording.write_bytes(cb.Setup("paper", object="banana").run(seed=1).recording)
    catchingbot.rerun.write(recording, out)
    rerun = lambda *what: subprocess.run([sys.executable, "-m", "rerun", "rrd", *what, str(out)], capture_output=True, text=True)
    assert rerun("verify").returncode == 0
    told = rerun("stats").stdout
    seen = viewed(recording)
    moved = {frame for frames, *_ in seen["surfaces"] for frame in frames}
    assert {"link_0", "link_7", "hand", "finger_left", "object"} <= moved == set(seen["poses"])
    cameras = sorted({camera for camera, *_ in seen["images"]})
    assert cameras == list(range(len(seen["cameras"])))
    names = [f"/world/{frame}" for frame in moved] + [f"/world/camera_{i:02}/depth" for i in cameras]
    for name in [*names, "/world/path_of_object", "/world/path_of_hand", "/world/predicted", "/story"]:
        assert f"{name}:" in told, name
    # The hand ends where the referee's samples end.
    assert abs(seen["poses"]["hand"][-1] - cb.Recording(recording).samples["X_WG"][-1]).max() < 0.01
