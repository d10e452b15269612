"""The same throws in the arena and in MuJoCo, side by side: `python run.py --scenario honest --object banana --trials 20`."""

import argparse
import json

import catchingbot as cb
from cell import MujocoCell

# By whether the arena and MuJoCo caught.
COUNTS = {(True, True): "both", (True, False): "arena_only", (False, True): "mujoco_only", (False, False): "neither"}


def thrown(setup: cb.Setup, seed: int, index: int) -> MujocoCell:
    """The cell in MuJoCo after a throw: the brain sees its images only, and moves its arm only."""
    cell, brain = MujocoCell(setup, seed, index), setup.brain(seed, index)
    while not cell.done:
        cell.act(brain.tick(cell.sense()))
    return cell


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="honest")
    for part in ["robot", "gripper", "object", "throw"]:
        parser.add_argument(f"--{part}")
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="the counts as one line of JSON, and nothing else")
    asked = parser.parse_args()
    setup = cb.Setup(asked.scenario, robot=asked.robot, gripper=asked.gripper, object=asked.object, throw=asked.throw)
    counts = {"trials": asked.trials, **dict.fromkeys(COUNTS.values(), 0)}
    for index in range(asked.trials):
        arena, mujoco = setup.run(asked.seed, index).reason, thrown(setup, asked.seed, index).why_not_caught()
        counts[COUNTS[arena is None, mujoco is None]] += 1
        if not asked.json:
            print(f"throw {index}: {arena or 'caught'} in the arena, {mujoco or 'caught'} in MuJoCo", flush=True)
    print(json.dumps(counts) if asked.json else ", ".join(f"{name} {count}" for name, count in counts.items()))


if __name__ == "__main__":
    main()
