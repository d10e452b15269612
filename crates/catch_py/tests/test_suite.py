"""The frozen benchmark: the program's rows and their hash."""

from __future__ import annotations

import json
import subprocess

import pytest

import catchingbot as cb


class Idle:
    def __init__(self, setup: cb.Setup, seed: int, index: int) -> None:
        pass

    def tick(self, observation: cb.Observation) -> None:
        return None


def test_python_and_the_program_give_one_hash(program, tmp_path):
    def run(brain: str) -> dict:
        arguments = ["suite", "run", "catch-2026.2", "--brain", brain, "--trials", "1", "--out", tmp_path, "--resume", "--json"]
        return json.loads(subprocess.run([program, *arguments], check=True, capture_output=True).stdout)

    suite, told = cb.suite("catch-2026.2"), []
    result = suite.run(trials=1, brain=Idle, progress=lambda done, total: told.append((done, total)))
    idle = run("idle")
    count = len(suite.conditions)
    assert result.rows_sha256 == idle["rows_sha256"] and result.content_sha256 == idle["content_sha256"]
    assert (idle["trials"], idle["caught"], idle["complete"]) == (count, int(result.table["caught"].sum()), False)
    assert told == [(i + 1, count) for i in range(count)] and not result.complete
    ours = run("ours")
    # What is there is not thrown again.
    assert suite.run(trials=1).rows_sha256 == ours["rows_sha256"] == run("ours")["rows_sha256"]
    assert ours["caught"] > idle["caught"]
    with pytest.raises(ValueError, match="NAME.*catch-2026.2"):
        cb.suite("catch-2025")
