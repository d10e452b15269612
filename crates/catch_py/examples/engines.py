"""Writes `docs/results/engines.md`: the same throws in the arena, in the arena at a quarter of its step, and in MuJoCo.

`python crates/catch_py/examples/engines.py --paper 20 --honest 10`, in an environment that has `catchingbot[mujoco]`.
"""

from __future__ import annotations

import argparse
import math
import platform
import subprocess
import sys
from pathlib import Path

import mujoco

import catchingbot as cb

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "examples/mujoco_cell"))
from run import throw  # noqa: E402

OBJECTS = ["tennis_ball", "banana", "pill_bottle"]
# Scenario, throw, and what the default is called on the page.
CONDITIONS = [("paper", "near_sampled"), ("paper", "far_sampled"), ("honest", "random")]


def row(name: str, pairs: list[tuple[bool, bool]]) -> str:
    """Counts of throws by who caught them, with the 95 % interval of the difference of paired rates by Agresti and Min (2005)."""
    n = len(pairs)
    both, first, second, neither = (pairs.count(it) for it in [(True, True), (True, False), (False, True), (False, False)])
    b, c, m = first + 0.5, second + 0.5, n + 2
    difference, half = (c - b) / m, 1.96 * math.sqrt(b + c - (b - c) ** 2 / m) / m
    interval = f"{100 * (difference - half):+.1f} to {100 * (difference + half):+.1f}"
    return f"| {name} | {n} | {both} | {first} | {second} | {neither} | {interval} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paper", type=int, default=20, help="throws of each object in `paper`, near and far")
    parser.add_argument("--honest", type=int, default=10, help="throws of each object in `honest`")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    engines, steps, differing = [], [], []
    for scenario, kind in CONDITIONS:
        for thing in OBJECTS:
            choice = {"object": thing, "throw": kind}
            setup = cb.Setup(scenario, **choice)
            finer = cb.Setup(scenario, **choice, settings={"arena.step_s": 2.5e-4})
            pairs, halved = [], []
            for index in range(getattr(asked, scenario)):
                arena, other, quarter = setup.run(asked.seed, index).reason, throw(setup, asked.seed, index), finer.run(asked.seed, index).reason
                pairs.append((arena is None, other is None))
                halved.append((arena is None, quarter is None))
                if (arena is None) != (other is None):
                    differing.append(f"| `{scenario}`, {kind}, {thing} | {index} | {arena or 'caught'} | {quarter or 'caught'} | {other or 'caught'} |")
                print(scenario, kind, thing, index, arena, quarter, other, flush=True)
            name = f"`{scenario}`, `{kind}`, {thing}"
            engines.append(row(name, pairs))
            steps.append(row(name, halved))
    page = PAGE.format(
        engines="\n".join(engines),
        steps="\n".join(steps),
        differing="\n".join(differing) or "| none | | | | |",
        mujoco=mujoco.__version__,
        version=cb.__version__,
        commit=subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip(),
        machine=platform.machine(),
        arguments=f"--paper {asked.paper} --honest {asked.honest} --seed {asked.seed}",
        seed=asked.seed,
    )
    (ROOT / "docs/results/engines.md").write_text(page)


PAGE = """# Two engines

The same throws in the arena and in [a cell around MuJoCo](../how-to/own-cell-in-python.md), closed loop: the brain sees images that
MuJoCo's rays give, and its commands drive MuJoCo's arm. Release, friction, restitution, air, masses, mount and the cameras' places are those of
the arena; noise and random numbers are the cell's own. One rule judges both. The throws are few, and the intervals say how few.

Written by `python crates/catch_py/examples/engines.py {arguments}` at {commit}, seed {seed}, MuJoCo {mujoco}, {machine}.

## The arena and MuJoCo

The interval is that of the difference of the rates, MuJoCo less arena, in points (95 %, paired: Agresti and Min, 2005).

| scenario, throw, object | throws | both | only the arena | only MuJoCo | neither | difference |
|---|---|---|---|---|---|---|
{engines}

## The arena and itself at a quarter of its step

| scenario, throw, object | throws | both | only the whole step | only a quarter | neither | difference |
|---|---|---|---|---|---|---|
{steps}

## Throws that end otherwise

| scenario, throw, object | throw | arena | a quarter of its step | MuJoCo |
|---|---|---|---|---|
{differing}
"""

if __name__ == "__main__":
    main()
