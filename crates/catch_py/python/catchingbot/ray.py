"""Evaluations on a Ray cluster, with the rows of a single machine.

>>> import ray, catchingbot as cb, catchingbot.ray
>>> ray.init(address="auto")
>>> table = cb.ray.evaluate(cb.Setup("honest"), trials=100_000, path="s3://bucket/honest")
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import fsspec
import ray

from catchingbot import Setup, Table, __version__

# A shard takes some seconds: a dead worker loses little, and sending costs little.
SHARD = 20
# glibc keeps freed memory in up to eight heaps a core. With two a worker's memory stays constant.
WORKER = {"env_vars": {"MALLOC_ARENA_MAX": "2"}}


def _throw(setup: Setup, first: int, trials: int, seed: int, brain: Any) -> tuple[bytes, float]:
    """Rows of one shard, and their computing time in seconds."""
    began = time.perf_counter()
    table = setup.evaluate(trials, seed=seed, first=first, threads=1, brain=brain)
    return table.jsonl, time.perf_counter() - began


def evaluate(
    setup: Setup,
    trials: int = 57,
    *,
    seed: int = 1,
    first: int = 0,
    shard: int = SHARD,
    brain: Callable[[Setup, int, int], Any] | None = None,
    path: str | None = None,
    progress: Callable[[int, int], object] | None = None,
    on_shard: Callable[[int, float], object] | None = None,
) -> Table:
    """Evaluates as ``Setup.evaluate``, in shards of ``shard`` throws on all cores of the cluster; the table has the same bytes.

    With ``path``, a folder in any file system of fsspec, each shard leaves its rows there as JSON lines and as Parquet. A stopped evaluation
    continues from these files. A shard whose worker died is repeated elsewhere. ``on_shard`` receives the first throw of each finished
    shard, and its duration in seconds.
    """
    for name, value, least in [("trials", trials, 1), ("shard", shard, 1), ("seed", seed, 0), ("first", first, 0)]:
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise ValueError(f"{name}: found {value!r}, expected a whole number from {least}")
    parts = _Parts(path, setup, seed) if path is not None else None
    shards = [(begin, min(shard, first + trials - begin)) for begin in range(first, first + trials, shard)]
    rows: dict[int, bytes] = {}
    for begin, count in shards:
        kept = parts.read(begin, count) if parts else None
        if kept is not None:
            rows[begin] = kept
    shared = ray.put(setup)
    throw = ray.remote(num_cpus=1, max_retries=-1, runtime_env=WORKER)(_throw)
    open_tasks = {
        throw.remote(shared, begin, count, seed, brain): (begin, count) for begin, count in shards if begin not in rows
    }
    done = sum(count for begin, count in shards if begin in rows)
    try:
        while open_tasks:
            [task], _ = ray.wait(list(open_tasks), num_returns=1)
            begin, count = open_tasks.pop(task)
            rows[begin], seconds = ray.get(task)
            if on_shard is not None:
                on_shard(begin, seconds)
            if parts:
                parts.write(begin, count, rows[begin])
            done += count
            if progress is not None:
                progress(done, trials)
    except BaseException:
        for task in open_tasks:
            ray.cancel(task, force=True)
        raise
    return Table.from_jsonl(b"".join(rows[begin] for begin, _ in shards))


class _Parts:
    """A folder with a part for each shard."""

    def __init__(self, path: str, setup: Setup, seed: int) -> None:
        self.files, self.folder = fsspec.core.url_to_fs(path)
        self.files.makedirs(self.folder, exist_ok=True)
        identity = {"version": __version__, "seed": seed, "scenario": setup.scenario}
        name = f"{self.folder}/evaluation.json"
        if self.files.exists(name):
            if json.loads(self.files.cat_file(name)) != identity:
                raise ValueError(f"path: found another evaluation in {path}, expected this one or an empty folder")
        else:
            self._put(name, json.dumps(identity, indent=1).encode())

    def _put(self, name: str, content: bytes) -> None:
        """Writes a file as a whole, so every existing file is complete."""
        self.files.pipe_file(f"{name}.unfinished", content)
        self.files.mv(f"{name}.unfinished", name)

    def _name(self, begin: int, count: int) -> str:
        return f"{self.folder}/part-{begin:012}-{count}"

    def read(self, begin: int, count: int) -> bytes | None:
        name = f"{self._name(begin, count)}.jsonl"
        return self.files.cat_file(name) if self.files.exists(name) else None

    def write(self, begin: int, count: int, jsonl: bytes) -> None:
        self._put(f"{self._name(begin, count)}.parquet", Table.from_jsonl(jsonl).parquet())
        self._put(f"{self._name(begin, count)}.jsonl", jsonl)
