"""Writes `docs/results/engines.md`: the same throws in the arena, in the arena at a quarter of its step, and in MuJoCo.

`python crates/catch_py/examples/engines.py --paper 20 --honest 10`, in an environment that has `catchingbot[mujoco]`.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import mujoco
import numpy as np

import catchingbot as cb

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "examples/mujoco_cell"))
from cell import PARTS  # noqa: E402
from rerun import rerun  # noqa: E402
from run import thrown  # noqa: E402

OBJECTS = ["tennis_ball", "banana", "pill_bottle"]
QUARTER = {"arena.step_s": 2.5e-4}
# Friction is drawn from 0.4 to 1.0 in `honest`.
LESS_FRICTION = {"arena.friction": {"min": 0.28, "max": 0.7}}
# By name: the option that says how many throws, the scenario, and what is different from it.
CONDITIONS = {
    "`paper`, near": ("paper", "paper", {"throw": "near_sampled"}),
    "`paper`, far": ("paper", "paper", {"throw": "far_sampled"}),
    "`honest`": ("honest", "honest", {}),
    "`honest`, friction × 0.7": ("friction", "honest", {"settings": LESS_FRICTION}),
    "`honest`, Panda, Franka Hand": ("arms", "honest", {"robot": "panda", "gripper": "franka_hand", "throw": "random_by_reach"}),
    "`honest`, UR5e, 2F-85": ("arms", "honest", {"robot": "ur5e", "gripper": "robotiq_2f85", "throw": "random_by_reach"}),
}
# Throws fly so long.
FLIGHT_S = 0.6
SINGLE = list(CONDITIONS)[:3]
NAMES = {"paper": "`paper`", "honest": "`honest`", "friction": "`honest`, friction × 0.7", "arms": "`honest`, other arms"}


def setup(condition: str, thing: str, **settings) -> cb.Setup:
    _, scenario, different = CONDITIONS[condition]
    return cb.Setup(scenario, object=thing, **{**different, "settings": {**different.get("settings", {}), **settings}})


def first_touch(parts: list[str], first_s) -> str:
    """The part that touched the object first."""
    return parts[int(np.argmin(first_s))] if np.isfinite(first_s).any() else "nothing"


def arena_touch(recording: cb.Recording) -> str:
    samples = recording.samples
    return first_touch(PARTS, [min(samples["time_s"][it > 0], default=np.inf) for it in samples["contacts"].T])


def closed_loop(condition: str, thing: str, seed: int, index: int) -> list[str]:
    """How a throw ends in the arena, in MuJoCo, and in the arena at a quarter of its step, each with a brain of its own."""
    ours = setup(condition, thing)
    cell = thrown(ours, seed, index)
    reasons = [ours.run(seed, index).reason, cell.why_not_caught(), setup(condition, thing, **QUARTER).run(seed, index).reason]
    return [it or "caught" for it in reasons]


def open_loop(condition: str, thing: str, seed: int, index: int) -> list[str]:
    """The same where all get the commands of the arena's brain."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "throw.catch"
        file.write_bytes(setup(condition, thing).run(seed, index).recording)
        recording = cb.Recording(file)
        arena, commands = setup(condition, thing, **QUARTER).arena(seed, index), iter(recording.commands)
        while not arena.done:
            arena.sense()
            arena.act(next(commands, (0.0, None))[1])
        reasons = [recording.reason, rerun(recording), None if arena.row["caught"] else "missed"]
        return [it or "caught" for it in reasons]


def touches(condition: str, thing: str, seed: int, index: int) -> list[str]:
    """What touches the object first in the arena and in MuJoCo, closed loop."""
    ours = setup(condition, thing)
    cell = thrown(ours, seed, index)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "throw.catch"
        file.write_bytes(ours.run(seed, index).recording)
        return [arena_touch(cb.Recording(file)), first_touch(PARTS, cell.first_s)]


WAYS = {"closed": closed_loop, "open": open_loop, "touches": touches}


def parts(seen: cb.Observation) -> tuple:
    """What a cell of one's own has before it makes an observation."""
    arm = (seen.arm.time_s, seen.arm.q, seen.arm.dq, seen.arm.commanded, seen.arm.executing, seen.arm.rejected)
    gripper = (seen.gripper.width_m, seen.gripper.speed_mps, seen.gripper.force_n, seen.gripper.grasp)
    return seen.time_s, arm, gripper, [(it.camera, it.capture_s, it.depth_m, it.window, it.mask) for it in seen.frames]


def tick_cost(scenario: str, images: int) -> str:
    """What a cell in Python adds to a tick: making the observation, over the ticks with so many images."""
    ours, made_ms, tick_ms = cb.Setup(scenario), [], []
    for index in range(5):
        arena, brain = ours.arena(1, index), ours.brain(1, index)
        while (seen := arena.sense()).time_s < FLIGHT_S:
            time_s, arm, gripper, images_of = parts(seen)
            began = time.thread_time()
            again = cb.Observation(time_s, cb.ArmState(*arm), cb.GripperState(*gripper), [cb.DepthFrame(*it) for it in images_of])
            made = time.thread_time()
            arena.act(brain.tick(again))
            if len(seen.frames) >= images:
                made_ms.append(1e3 * (made - began))
                tick_ms.append(1e3 * (time.thread_time() - made))
    figures = [np.median(made_ms), np.quantile(made_ms, 0.95), np.median(tick_ms)]
    return f"| `{scenario}`, {images} images | {len(made_ms)} | " + " | ".join(f"{it:.3f}" for it in figures) + " |"


def ends_of(asked: list) -> list[str]:
    way, *throw = asked
    return WAYS[way](*throw)


def work_off(kept: Path, wanted: list[list]) -> dict[str, list[str]]:
    """The ends of all wanted throws; those that are in `kept` are not thrown again."""
    lines = kept.read_text().splitlines() if kept.exists() else []
    done = {json.dumps(it["asked"]): it["ends"] for it in map(json.loads, lines)}
    open_ones = [it for it in wanted if json.dumps(it) not in done]
    with kept.open("a") as file, ProcessPoolExecutor() as pool:
        running = {pool.submit(ends_of, it): it for it in open_ones}
        for future in as_completed(running):
            done[json.dumps(running[future])] = future.result()
            print(json.dumps({"asked": running[future], "ends": future.result()}), file=file, flush=True)
            print(f"{len(done)} of {len(lines) + len(open_ones)}", *running[future], *future.result(), flush=True)
    return done


def compared(throws: list[list[str]], other: int) -> str:
    """How many throws the arena alone caught and the `other` of the ends alone, and the difference of the paired rates with its 95 % interval
    by Agresti and Min (2005)."""
    pairs, n = [(it[0] == "caught", it[other] == "caught") for it in throws], len(throws)
    first, second = pairs.count((True, False)), pairs.count((False, True))
    b, c, m = first + 0.5, second + 0.5, n + 2
    difference, half = (c - b) / m, 1.96 * math.sqrt(b + c - (b - c) ** 2 / m) / m
    interval = f"{100 * (difference - half):+.1f} to {100 * (difference + half):+.1f}"
    return f" {first}/{second} | {100 * (second - first) / n:+.1f} ({interval}) |"


def table(ends, way: str, others: list[int], conditions: list[str]) -> str:
    """Rows of the objects whose throws do not all end alike, and of all objects."""
    rows, every = [], {}
    for title in conditions:
        for thing in OBJECTS:
            throws = [it for key, it in ends.items() if json.loads(key)[:3] == [way, title, thing]]
            if any(len({end == "caught" for end in it}) > 1 for it in throws):
                rows.append((f"{title}, {thing}", throws))
            every.setdefault(CONDITIONS[title][0], []).extend(throws)
    rows += [(f"{NAMES[option]}, all", throws) for option, throws in every.items() if throws]
    return "\n".join(
        f"| {name} | {len(throws)} | {sum(it[0] == 'caught' for it in throws)} |" + "".join(compared(throws, it) for it in others) for name, throws in rows
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paper", type=int, default=20, help="throws of each object in `paper`, near and far")
    parser.add_argument("--honest", type=int, default=10, help="throws of each object in `honest`")
    parser.add_argument("--open", type=int, default=10, help="throws of each object in `paper`, near and far, and in `honest`, open loop")
    parser.add_argument("--friction", type=int, default=0, help="throws of each object with less friction")
    parser.add_argument("--arms", type=int, default=0, help="throws of each object with each of two other arms")
    parser.add_argument("--seed", type=int, nargs="+", default=[1], help="seeds, each with so many throws; tables count all of them")
    parser.add_argument("--kept", type=Path, default=ROOT / "target/engines.jsonl", help="throws that are done; those are not thrown again")
    asked = parser.parse_args()
    wanted = [
        [way, title, thing, seed, index]
        for title, (option, *_) in CONDITIONS.items()
        for way, count in [("closed", getattr(asked, option)), ("open", asked.open if title in SINGLE else 0)]
        for index in range(count)
        for seed in asked.seed
        for thing in OBJECTS
    ]
    ends = work_off(asked.kept, wanted)
    ends = {key: ends[key] for key in map(json.dumps, wanted)}
    differing = [it for it in map(json.loads, ends) if it[0] == "closed" and len({end == "caught" for end in ends[json.dumps(it)][:2]}) > 1]
    touched = work_off(asked.kept, [["touches", *it[1:]] for it in differing])
    by_ends = {}
    for it in differing:
        arena, other, finer = ends[json.dumps(it)]
        mark = "*" if (finer == "caught") == (other == "caught") else ""
        by_ends.setdefault(f"| {it[1]}, {it[2]} | {arena} | {other} |", []).append(f"{it[3]}/{it[4]}{mark}")
    page = PAGE.format(
        closed=table(ends, "closed", [1, 2], SINGLE),
        open=table(ends, "open", [1, 2], SINGLE),
        others=table(ends, "closed", [1], list(CONDITIONS)[3:]),
        ticks="\n".join(tick_cost(*it) for it in [("honest", 20), ("lab", 2)]),
        differing="\n".join(f"{name} {' '.join(throws)} |" for name, throws in by_ends.items()) or "| none | | | |",
        same_part=sum(len(set(touched[json.dumps(["touches", *it[1:]])])) == 1 for it in differing),
        all_differing=len(differing),
        mujoco=mujoco.__version__,
        version=cb.__version__,
        commit=subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip(),
        machine=f"{platform.machine()}, {os.cpu_count()} cores",
        arguments=" ".join([*(f"--{it} {getattr(asked, it)}" for it in ["paper", "honest", "open", "friction", "arms"]), "--seed", *map(str, asked.seed)]),
    )
    (ROOT / "docs/results/engines.md").write_text(page)


PAGE = """# Results: two engines

This page is written by a command; changes by hand get lost.

The same throws in the arena, in [a cell around MuJoCo](../how-to/own-cell-in-python.md), and in the arena at a *quarter* of its step. Release,
friction, restitution, air, masses, mount and the places of the cameras are those of the arena. Noise is the cell's own. One rule judges all.

| | |
|---|---|
| command | `python crates/catch_py/examples/engines.py {arguments}` |
| version | {version}, MuJoCo {mujoco} |
| commit | {commit} |
| machine | {machine} |

Tables count throws, and those that the arena catches. *Only* has those that the arena alone catches, and those that the other alone catches.
The *difference* of the rates, the other less the arena, is in points, with its 95 % interval for pairs (Agresti and Min, 2005). Objects have
equally many throws of a condition. Those whose throws all end alike have no row of their own.

## Closed loop

The brain sees images that MuJoCo's rays give, and its commands drive MuJoCo's arm.

| condition, object | throws | arena | only, MuJoCo | difference | only, quarter | difference |
|---|---|---|---|---|---|---|
{closed}

## Open loop

The commands of the arena's brain drive the other arm at the recorded times, whatever becomes of the object.

| condition, object | throws | arena | only, MuJoCo | difference | only, quarter | difference |
|---|---|---|---|---|---|---|
{open}

## Less friction, other arms

Closed loop. Friction × 0.7 is that of both engines.

| condition, object | throws | arena | only, MuJoCo | difference |
|---|---|---|---|---|
{others}

## A tick in Python

CPU time of the thread in ms, over the ticks with so many images in the first 0.6 s of five throws. A cell in Python makes each observation by
the constructors of the package from arrays. The rest of a tick is the brain and the arena.

| scenario | ticks | observation, median | observation, 95 % | rest, median |
|---|---|---|---|---|
{ticks}

## Throws that end differently

Closed loop, as seed/throw, marked * where the arena at a quarter of its step ends as MuJoCo does: caught or not. In {same_part} of
{all_differing} throws the same part touches the object first in both engines.

| condition, object | arena | MuJoCo | throws |
|---|---|---|---|
{differing}
"""

if __name__ == "__main__":
    main()
