"""The same throws in the arena and in MuJoCo, side by side: `python run.py --scenario honest --object banana --trials 20`."""

from __future__ import annotations

import argparse
import json

import catchingbot as cb

from cell import MujocoCell


def thrown(setup: cb.Setup, seed: int, index: int) -> MujocoCell:
    """The cell in MuJoCo after a throw."""
    cell, brain = MujocoCell(setup, seed, index), setup.brain(seed, index)
    while not cell.done:
        cell.act(brain.tick(cell.sense()))
    return cell


def compare(setup: cb.Setup, trials: int, seed: int, tell=lambda *_: None) -> dict[str, int]:
    """How many of the same throws are caught in both, in one of them, in none."""
    counts = {"trials": trials, "both": 0, "arena_only": 0, "mujoco_only": 0, "neither": 0}
    for index in range(trials):
        arena, mujoco = setup.run(seed, index).reason, thrown(setup, seed, index).why_not_caught()
        caught = (arena is None, mujoco is None)
        counts[{(True, True): "both", (True, False): "arena_only", (False, True): "mujoco_only", (False, False): "neither"}[caught]] += 1
        tell(index, arena or "caught", mujoco or "caught")
    return counts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="honest")
    for part in ["robot", "gripper", "object", "throw"]:
        parser.add_argument(f"--{part}")
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="one line of JSON instead of a table")
    asked = parser.parse_args()
    setup = cb.Setup(asked.scenario, robot=asked.robot, gripper=asked.gripper, object=asked.object, throw=asked.throw)
    tell = (lambda *_: None) if asked.json else (lambda index, *why: print(f"{index:5}  {why[0]:20}  {why[1]}", flush=True))
    if not asked.json:
        print("throw  arena                 mujoco")
    counts = compare(setup, asked.trials, asked.seed, tell)
    print(json.dumps(counts) if asked.json else ", ".join(f"{name} {count}" for name, count in counts.items()))


if __name__ == "__main__":
    main()
