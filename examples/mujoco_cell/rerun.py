"""What a brain commanded in the arena, once more in MuJoCo, without looking: `python rerun.py out/catch/*.catch`.

The arm gets the recorded commands at the recorded times, whatever becomes of the object: no brain corrects itself.
"""

import argparse
import json
from pathlib import Path

import catchingbot as cb
from cell import MujocoCell


def rerun(recording: cb.Recording) -> str | None:
    """Throws once in MuJoCo; why the object was not caught."""
    cell, commands = MujocoCell(recording.setup, recording.seed, recording.index), list(recording.commands)
    while not cell.done:
        cell.wait()
        while commands and commands[0][0] <= cell.time_s + 1e-9:
            cell.act(commands.pop(0)[1])
    return cell.why_not_caught()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", metavar="RECORDING", type=Path, nargs="+", help="throws that `catchingbot catch` recorded")
    parser.add_argument("--json", action="store_true", help="one line of JSON for each recording")
    asked = parser.parse_args()
    for file in asked.recordings:
        recording = cb.Recording(file)
        arena, mujoco = recording.reason or "caught", rerun(recording) or "caught"
        print(json.dumps({"recording": str(file), "arena": arena, "mujoco": mujoco}) if asked.json else f"{file}: {arena} in the arena, {mujoco} in MuJoCo")


if __name__ == "__main__":
    main()
