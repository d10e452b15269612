"""Evaluations on a local Ray cluster of two workers."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import catchingbot as cb

pytestmark = pytest.mark.slow
ray = pytest.importorskip("ray")


@pytest.fixture(scope="module")
def cluster():
    from catchingbot import ray as cluster

    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    yield cluster
    ray.shutdown()


def workers() -> list[int]:
    """Processes that throw for this session."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if (folder / "cmdline").read_bytes().startswith(b"ray::_throw"):
                found.append(int(folder.name))
        except OSError:
            pass
    return found


def test_a_cluster_gives_the_bytes_of_one_machine_though_a_worker_is_killed(cluster, setup, tmp_path):
    killed = []

    def kill():
        while not killed:
            time.sleep(0.2)
            for worker in workers()[:1]:
                os.kill(worker, signal.SIGKILL)
                killed.append(worker)

    thread = threading.Thread(target=kill)
    thread.start()
    told: list[tuple[int, int]] = []
    table = cluster.evaluate(setup, 24, shard=4, path=str(tmp_path / "parts"), progress=lambda *it: told.append(it))
    thread.join()
    expected = setup.evaluate(24)
    assert killed and table.jsonl == expected.jsonl and told[-1] == (24, 24)
    assert all(np.array_equal(table[name], expected[name], equal_nan=table[name].dtype.kind == "f") for name in table)
    # What is there is not thrown again, and what is missing is.
    parts = sorted((tmp_path / "parts").glob("*.jsonl"))
    assert len(parts) == 6 == len(list((tmp_path / "parts").glob("*.parquet")))
    parts[2].unlink()
    told.clear()
    assert cluster.evaluate(setup, 24, shard=4, path=str(tmp_path / "parts"), progress=lambda *it: told.append(it)).jsonl == expected.jsonl
    assert told == [(24, 24)]
    with pytest.raises(ValueError, match="^path"):
        cluster.evaluate(setup, 24, seed=2, path=str(tmp_path / "parts"))


def test_arguments_are_named(cluster, setup):
    for argument in ["trials", "shard", "seed", "first"]:
        with pytest.raises(ValueError, match=f"^{argument}"):
            cluster.evaluate(setup, **{argument: -1})
    with pytest.raises(ZeroDivisionError):
        cluster.evaluate(setup, 4, shard=2, brain=lambda *_: 1 / 0)
