"""A LeRobotDataset of the program, read back by the package `lerobot`.

It is in an environment of its own, without this package: `pip install "lerobot[dataset]" pytest`, then `pytest --noconftest -m slow` with this file.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
os.environ["HF_HUB_OFFLINE"] = "1"
lerobot = pytest.importorskip("lerobot.datasets.lerobot_dataset")

PROGRAM = Path(os.environ.get("CATCHINGBOT", Path(__file__).resolve().parents[3] / "target/release/catchingbot"))


def test_lerobot_reads_what_the_program_writes(tmp_path):
    arguments = ["--object", "banana", "--throw", "near_sampled", "--trials", "2", "--lerobot", tmp_path / "dataset"]
    subprocess.run([PROGRAM, "export", *arguments], check=True, capture_output=True)
    dataset = lerobot.LeRobotDataset("catchingbot/banana", root=tmp_path / "dataset")
    assert dataset.num_episodes == 2 and dataset.fps == 100 and len(dataset) == dataset.meta.total_frames
    assert len(dataset.meta.depth_keys) == sum(key.startswith("observation.images.depth_") for key in dataset.features)
    frame = dataset[20]
    assert frame["observation.state"].shape == (15,) and frame["action"].shape == (8,)
    assert frame["task"] == "catch the banana" and frame["timestamp"].item() == pytest.approx(0.2)
    depth_mm = frame["observation.images.depth_0"]
    assert depth_mm.shape == (1, 300, 400) and 500 < depth_mm.max() < 20_000
    last = dataset[len(dataset) - 1]
    assert last["next.done"] and last["next.reward"] == 1 and last["episode_index"] == 1
    # What is asked for is where the arm is an image later, but for what the robot controller lacks.
    second = lerobot.LeRobotDataset("catchingbot/banana", root=tmp_path / "dataset", episodes=[1], delta_timestamps={"action": [0, 0.01]})
    following = second[50]["action"]
    assert following.shape == (2, 8) and (following[0, :7] - second[51]["observation.state"][:7]).abs().max() < 0.01
