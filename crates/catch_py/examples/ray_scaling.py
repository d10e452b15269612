"""Two Ray workers against two threads, and what a thousand cores would give by a simulated schedule.

    pip install "./crates/catch_py[ray]"
    python crates/catch_py/examples/ray_scaling.py --page docs/results/ray.md
"""

from __future__ import annotations

import argparse
import heapq
import platform
import threading
import time
from pathlib import Path

import numpy as np
import ray

import catchingbot as cb
import catchingbot.ray as cluster

CORES = 1000
# Of a hundred cores one takes three times as long, and each shard is lost halfway with its worker once in a thousand times.
SLOW_FRACTION, SLOW_BY, LOST_FRACTION = 0.01, 3.0, 0.001


class Memory(threading.Thread):
    """Resident memory of this process and of the workers, once a second."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.ended, self.driver_mb, self.worker_mb = threading.Event(), [], []

    def run(self) -> None:
        while not self.ended.wait(1.0):
            self.driver_mb.append(resident_mb(Path("/proc/self")))
            workers = [resident_mb(it) for it in Path("/proc").glob("[0-9]*") if is_worker(it)]
            self.worker_mb.append(max(workers, default=0.0))


def is_worker(process: Path) -> bool:
    try:
        return (process / "cmdline").read_bytes().startswith(b"ray::_throw")
    except OSError:
        return False


def resident_mb(process: Path) -> float:
    try:
        lines = (process / "status").read_text().splitlines()
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))
    except (OSError, StopIteration):
        return 0.0


def quarters(values: list[float]) -> str:
    """Medians of the second quarter of a run and of its last."""
    n = len(values) // 4
    return f"{np.median(values[n : 2 * n]):.0f} → {np.median(values[-n:]):.0f}"


def schedule_s(shard_s: np.ndarray, begin_s: float, rng: np.random.Generator, has_stragglers: bool) -> float:
    """When the last of these shards is done if each goes to the core that is free first and the driver begins one every ``begin_s``."""
    speeds = np.ones(CORES)
    if has_stragglers:
        speeds[rng.random(CORES) < SLOW_FRACTION] = SLOW_BY
    free = [(0.0, i) for i in range(CORES)]
    heapq.heapify(free)
    end_s = 0.0
    for number, duration_s in enumerate(shard_s):
        at_s, core = heapq.heappop(free)
        if has_stragglers and rng.random() < LOST_FRACTION:
            duration_s *= 1.5
        done_s = max(at_s, number * begin_s) + duration_s * speeds[core]
        end_s = max(end_s, done_s)
        heapq.heappush(free, (done_s, core))
    return end_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--scenario", default="honest")
    parser.add_argument("--page", type=Path, help="a page of results to write")
    arguments = parser.parse_args()
    setup, trials = cb.Setup(arguments.scenario), arguments.trials
    setup.evaluate(2)

    began = time.perf_counter()
    expected = setup.evaluate(trials, threads=2)
    threads_s = time.perf_counter() - began

    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    # Workers begin, import the package and prepare the setup: once for a session, whatever is thrown.
    began = time.perf_counter()
    cluster.evaluate(setup, 4, shard=1)
    start_s = time.perf_counter() - began
    memory, shards = Memory(), []
    memory.start()
    began = time.perf_counter()
    table = cluster.evaluate(setup, trials, on_shard=lambda _, seconds: shards.append(seconds))
    ray_s = time.perf_counter() - began
    memory.ended.set()
    assert table.jsonl == expected.jsonl
    nothing = ray.remote(lambda: None)
    began = time.perf_counter()
    ray.get([nothing.remote() for _ in range(2000)])
    begin_s = (time.perf_counter() - began) / 2000
    ray.shutdown()

    rng = np.random.default_rng(1)
    lines = []
    for count in [10_000, 100_000, 1_000_000]:
        drawn = rng.choice(np.array(shards), count // cluster.SHARD)
        ideal_s = drawn.sum() / CORES
        even_s, real_s = (schedule_s(drawn, begin_s, np.random.default_rng(2), it) for it in [False, True])
        lines.append(f"| {count:,} | {len(drawn):,} | {ideal_s:.1f} | {even_s:.1f} | {real_s:.1f} | {100 * ideal_s / real_s:.0f} |")
    page = f"""# Results: Ray

This page is written by a command; changes by hand get lost.

What is measured: {trials:,} throws of the scenario `{arguments.scenario}` by two Ray workers on one machine and by two threads of one process.

| | |
|---|---|
| command | `python crates/catch_py/examples/ray_scaling.py --trials {trials} --scenario {arguments.scenario}` |
| version | {cb.__version__}, Ray {ray.__version__} |
| machine | {platform.machine()}, 2 cores |

The rows have the same bytes. The start of the workers stands apart; it comes once in a session. Memory is the median of the second quarter of
the run and that of the last.

| | |
|---|---|
| two threads, s | {threads_s:.1f} |
| two workers, s | {ray_s:.1f} |
| throughput of the workers, % of the threads' | {100 * threads_s / ray_s:.1f} |
| start of the workers, s | {start_s:.1f} |
| a shard of {cluster.SHARD} throws, s: median, longest | {np.median(shards):.2f}, {max(shards):.2f} |
| memory of a worker, MiB | {quarters(memory.worker_mb)} |
| memory of the driver, MiB | {quarters(memory.driver_mb)} |
| an empty task, ms | {1e3 * begin_s:.2f} |

## A thousand cores

A simulated schedule. Shards take the measured times, drawn at random. Each goes to the core that is free first, and the driver begins one in
the time of an empty task. *Even* has equal cores. With *stragglers* {100 * SLOW_FRACTION:g} % of the cores take {SLOW_BY:g} times as long, and
{100 * LOST_FRACTION:g} % of the shards are lost halfway and thrown again. Efficiency is that of the last against the work divided by the cores.

| throws | shards | work / cores, s | even, s | stragglers, s | efficiency, % |
| --- | --- | --- | --- | --- | --- |
{chr(10).join(lines)}
"""
    print(page)
    if arguments.page:
        arguments.page.write_text(page)


if __name__ == "__main__":
    main()
