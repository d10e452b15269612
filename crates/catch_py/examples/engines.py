"""Writes `docs/results/engines.md`: the same throws in the arena, in the arena at a quarter of its step, and in MuJoCo.

`python crates/catch_py/examples/engines.py --paper 20 --honest 10`, in an environment that has `catchingbot[mujoco]`.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import sys
from pathlib import Path

import mujoco

import catchingbot as cb

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "examples/mujoco_cell"))
from run import throw  # noqa: E402

OBJECTS = ["tennis_ball", "banana", "pill_bottle"]
# Scenario and throw.
CONDITIONS = [("paper", "near_sampled"), ("paper", "far_sampled"), ("honest", "random")]


def row(name: str, throws: list[list[str | None]], other: int) -> str:
    """Counts of throws by who caught them, the arena or the `other` of the outcomes, with the 95 % interval of the difference of paired
    rates by Agresti and Min (2005)."""
    pairs, n = [(it[0] is None, it[other] is None) for it in throws], len(throws)
    both, first, second, neither = (pairs.count(it) for it in [(True, True), (True, False), (False, True), (False, False)])
    b, c, m = first + 0.5, second + 0.5, n + 2
    difference, half = (c - b) / m, 1.96 * math.sqrt(b + c - (b - c) ** 2 / m) / m
    interval = f"{100 * (difference - half):+.1f} to {100 * (difference + half):+.1f}"
    return f"| {name} | {n} | {both} | {first} | {second} | {neither} | {interval} |"


def outcomes(kept: Path, scenario: str, kind: str, thing: str, seed: int, index: int) -> list[str | None]:
    """Why the object was not caught in the arena, in MuJoCo, and in the arena at a quarter of its step; throws that are in `kept` are not
    thrown again."""
    asked = [scenario, kind, thing, seed, index]
    rows = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    if (found := next((it["outcomes"] for it in rows if it["throw"] == asked), None)) is not None:
        return found
    setup = cb.Setup(scenario, object=thing, throw=kind)
    finer = cb.Setup(scenario, object=thing, throw=kind, settings={"arena.step_s": 2.5e-4})
    found = [setup.run(seed, index).reason, throw(setup, seed, index), finer.run(seed, index).reason]
    with kept.open("a") as file:
        file.write(json.dumps({"throw": asked, "outcomes": found}) + "\n")
    print(*asked, *found, flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paper", type=int, default=20, help="throws of each object in `paper`, near and far")
    parser.add_argument("--honest", type=int, default=10, help="throws of each object in `honest`")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kept", type=Path, default=ROOT / "target/engines.jsonl", help="throws that are done")
    asked = parser.parse_args()
    engines, steps, differing = [], [], []
    every = {scenario: [] for scenario, _ in CONDITIONS}
    for scenario, kind in CONDITIONS:
        for thing in OBJECTS:
            throws = [outcomes(asked.kept, scenario, kind, thing, asked.seed, index) for index in range(getattr(asked, scenario))]
            name = f"`{scenario}`, `{kind}`, {thing}"
            every[scenario] += throws
            engines.append(row(name, throws, 1))
            steps.append(row(name, throws, 2))
            for index, found in enumerate(throws):
                if len({it is None for it in found}) > 1:
                    differing.append(f"| {name} | {index} | " + " | ".join(it or "caught" for it in found) + " |")
    for scenario, throws in every.items():
        engines.append(row(f"`{scenario}`, all", throws, 1))
        steps.append(row(f"`{scenario}`, all", throws, 2))
    page = PAGE.format(
        engines="\n".join(engines),
        steps="\n".join(steps),
        differing="\n".join(differing) or "| none | | | | |",
        mujoco=mujoco.__version__,
        version=cb.__version__,
        machine=f"{platform.machine()}, {os.cpu_count()} cores",
        arguments=f"--paper {asked.paper} --honest {asked.honest} --seed {asked.seed}",
        seed=asked.seed,
    )
    (ROOT / "docs/results/engines.md").write_text(page)


PAGE = """# Results: two engines

This page is written by a command; changes by hand get lost.

The same throws in the arena and in [a cell around MuJoCo](../how-to/own-cell-in-python.md), closed loop. The brain sees images that MuJoCo's
rays give, and its commands drive MuJoCo's arm. Release, friction, restitution, air, masses, mount and the places of the cameras are those of
the arena. Noise is the cell's own. One rule judges both.

| | |
|---|---|
| command | `python crates/catch_py/examples/engines.py {arguments}` |
| version | {version}, MuJoCo {mujoco} |
| machine | {machine} |

## The arena and MuJoCo

The last column is the 95 % interval of the difference of the paired rates in points, MuJoCo less arena (Agresti and Min, 2005). It is wide
where throws are few.

| scenario, throw, object | throws | both | only the arena | only MuJoCo | neither | difference |
|---|---|---|---|---|---|---|
{engines}

## The arena and itself at a quarter of its step

| scenario, throw, object | throws | both | only the whole step | only a quarter | neither | difference |
|---|---|---|---|---|---|---|
{steps}

## Throws that do not end alike in all three

| scenario, throw, object | throw | arena | MuJoCo | arena at a quarter of its step |
|---|---|---|---|---|
{differing}
"""

if __name__ == "__main__":
    main()
