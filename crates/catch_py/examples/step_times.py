"""What a step of the environment costs, what a tick of the brain adds to the arena, and `Setup.evaluate` against `catchingbot eval`.

    pip install ./crates/catch_py
    python crates/catch_py/examples/step_times.py target/release/catchingbot --page docs/results/python-times.md
"""

from __future__ import annotations

import argparse
import platform
import resource
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import catchingbot as cb

SCENARIO = "honest"


def cpu_ms(work: Callable[[], object]) -> tuple[float, object]:
    """CPU time of the whole process for some work, in milliseconds, and what came of it."""
    began = time.process_time()
    result = work()
    return 1e3 * (time.process_time() - began), result


def steps_ms(setup: cb.Setup, obs: str, throws: int) -> list[float]:
    """CPU time of a step with random actions, in milliseconds, a mean for each throw."""
    rng, means = np.random.default_rng(1), []
    for index in range(throws):
        arena, costs, done = setup.steered_arena(1, index, obs=obs, action="acceleration"), [], False
        while not done:
            action = rng.uniform(-1.0, 1.0, setup.dof + 1)
            ms, done = cpu_ms(lambda: (arena.step(action), arena.observation)[0])
            costs.append(ms)
        arena.close()
        means.append(np.mean(costs))
    return means


def ticks_ms(setup: cb.Setup, throws: int, has_brain: bool) -> tuple[list[float], list[float]]:
    """CPU times of the arena and of the brain from image to image, in milliseconds, a mean for each throw."""
    of_arena, of_brain = [], []
    for index in range(throws):
        arena, brain, costs, thoughts = setup.arena(1, index), setup.brain(1, index), [], []
        while not arena.done:
            sense_ms, seen = cpu_ms(arena.sense)
            tick_ms, command = cpu_ms(lambda: brain.tick(seen)) if has_brain else (0.0, None)
            act_ms, _ = cpu_ms(lambda: arena.act(command))
            costs.append(sense_ms + act_ms)
            thoughts.append(tick_ms)
        of_arena.append(np.mean(costs))
        of_brain.append(np.mean(thoughts))
    return of_arena, of_brain


def evaluations_s(setup: cb.Setup, program: str, trials: int, rounds: int) -> list[tuple[float, float]]:
    """CPU times of the program and of this process for the same throws, in seconds, in turn."""
    pairs = []
    for seed in range(1, rounds + 1):
        with tempfile.TemporaryDirectory() as out:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            command = [program, "eval", "--scenario", SCENARIO, "--seed", str(seed), "--trials", str(trials), "--out", out]
            subprocess.run(command, check=True, capture_output=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            rows = (Path(out) / "trials.jsonl").read_bytes()
        program_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        ms, table = cpu_ms(lambda: setup.evaluate(trials, seed=seed))
        assert table.jsonl == rows
        pairs.append((program_s, ms / 1e3))
    return pairs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", help="the program catchingbot")
    parser.add_argument("--throws", type=int, default=40)
    parser.add_argument("--page", type=Path, help="a page of results to write")
    arguments = parser.parse_args()
    setup, throws = cb.Setup(SCENARIO), arguments.throws
    kinds = ["state", "pose", "cloud", "depth"]
    steps = {obs: steps_ms(setup, obs, throws) for obs in kinds}
    untold, _ = ticks_ms(setup, throws, has_brain=False)
    told, brain = ticks_ms(setup, throws, has_brain=True)
    row = lambda name, values: f"| {name} | {np.median(values):.2f} | {np.min(values):.2f} – {np.max(values):.2f} | {np.median(values) / np.median(untold):.2f} |"
    rows = [row(f"a step with `obs=\"{obs}\"`", values) for obs, values in steps.items()]
    rows += [row("`arena.sense()`, `arena.act(None)`", untold), row("the same with the brain's commands", told)]
    rows += [row("`brain.tick(observation)`", brain)]
    pairs = evaluations_s(setup, arguments.program, 4 * throws, 5)
    ratios = [b / a for a, b in pairs]
    page = f"""# Results: times in Python

This page is written by a command; changes by hand get lost.

What is measured: what a step of the environment and a tick of the brain cost, and `Setup.evaluate` against the program.

| | |
|---|---|
| command | `python crates/catch_py/examples/step_times.py target/release/catchingbot --throws {throws}` |
| version | {cb.__version__} |
| machine | {platform.machine()}, 2 cores |

## From image to image

{throws} random throws of `{SCENARIO}`, seed 1. A step moves the arena until the next image. Times are CPU times of the process. The first column is
the median over throws of a throw's mean, the second its range. The last is the ratio to the arena that is told nothing, where each camera
takes whole images and the arm stands still. Actions are random accelerations.

| what | ms | range | ratio |
| --- | --- | --- | --- |
{chr(10).join(rows)}

## Evaluations

{4 * throws} throws each, in turn, two threads; the rows have the same bytes.

| seed | `catchingbot eval`, s | `Setup.evaluate`, s | ratio |
| --- | --- | --- | --- |
{chr(10).join(f"| {i + 1} | {a:.2f} | {b:.2f} | {b / a:.3f} |" for i, (a, b) in enumerate(pairs))}

The median of the ratios is {np.median(ratios):.3f}. The program also prepares its setup and writes its table, its page and the pages of misses.
"""
    print(page)
    if arguments.page:
        arguments.page.write_text(page)


if __name__ == "__main__":
    main()
