"""The same scene gives the same bytes, whoever throws."""

from __future__ import annotations

import json
import subprocess
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import catchingbot as cb

TRIALS = 4


def stepped(setup: cb.Setup, index: int, brain=None) -> bytes:
    arena, brain = setup.arena(seed=1, index=index), brain or setup.brain(seed=1, index=index)
    while not arena.done:
        arena.act(brain.tick(arena.sense()))
    return arena.jsonl


def test_program_evaluation_single_throws_and_steps_give_the_same_bytes(setup, program, tmp_path):
    arguments = ["--scenario", "paper", "--object", "banana", "--throw", "near_sampled", "--trials", str(TRIALS), "--out", str(tmp_path)]
    subprocess.run([program, "eval", *arguments, "--json"], check=True, capture_output=True)
    expected = (tmp_path / "trials.jsonl").read_bytes()
    table = setup.evaluate(trials=TRIALS, threads=1)
    assert table.jsonl == expected
    assert setup.evaluate(trials=TRIALS, threads=3).jsonl == expected
    lines = expected.splitlines(keepends=True)
    assert [setup.run(seed=1, index=index).jsonl for index in range(2)] == lines[:2]
    assert stepped(setup, 1) == lines[1]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda index: stepped(setup, index), range(TRIALS))) == lines
    assert table.rows() == [json.loads(line) for line in lines]
    assert setup.evaluate(trials=1, first=2).jsonl == lines[2]
    again = cb.Table.from_jsonl(expected)
    assert all(np.array_equal(again[name], table[name], equal_nan=table[name].dtype.kind == "f") for name in table)
    assert table.parquet()[:4] == b"PAR1"
    with pytest.raises(ValueError, match="^jsonl: found line 2"):
        cb.Table.from_jsonl(lines[0] + b"{}")


def test_columns_are_arrays(setup):
    table = setup.evaluate(trials=2)
    assert table["caught"].dtype == np.bool_ and table["index"].dtype == np.int64
    assert table["prediction_error_m"].dtype == np.float64 and table["object"].dtype.kind == "U"
    assert list(table["index"]) == [0, 1] and set(table["object"]) == {"banana"}
    assert {len(column) for column in table.values()} == {2}
    assert [row["caught"] for row in table.rows()] == table["caught"].tolist()
    assert "2 caught" in repr(table)


def test_settings_have_the_names_of_the_command_line(program, tmp_path):
    setup = cb.Setup("paper", settings={"arena.drag": False, "clock": {"fixed_ms": 5}, "throw": "far"})
    assert setup.scenario["arena"]["drag"] is False and setup.scenario["throw"] == "far"
    arguments = ["--scenario", "paper", "--set", "arena.drag=false", "--set", "clock={ fixed_ms = 5 }", "--set", "throw=far"]
    subprocess.run([program, "eval", *arguments, "--trials", "1", "--out", str(tmp_path), "--json"], check=True, capture_output=True)
    assert setup.evaluate(trials=1).jsonl == (tmp_path / "trials.jsonl").read_bytes()


def test_a_throw_shows_itself(setup, program, tmp_path):
    trial = setup.run(seed=1, index=0)
    assert trial.caught and trial.reason is None
    assert trial.row["object"] == "banana" and trial.row["caught"] is True
    page = trial.html()
    assert page.startswith("<!") and "banana" in page
    assert trial._repr_html_().startswith("<iframe")
    recording = tmp_path / "throw.catch"
    recording.write_bytes(trial.recording)
    replayed = subprocess.run([program, "replay", recording, "--json"], check=True, capture_output=True)
    assert json.loads(replayed.stdout)
    assert "caught" in repr(trial)


def test_a_folder_of_recorded_tracks_is_a_throw(tmp_path):
    rows = (f"{t},{5.0 * t},{1.2 + 4.0 * t - 4.905 * t * t},{0.1 * t}" for t in np.arange(60) / 100.0)
    (tmp_path / "one.csv").write_text("t,x,y,z\n" + "\n".join(rows) + "\n")
    setup = cb.Setup("paper", object="tennis_ball", throw=str(tmp_path), settings={"arena.drag": True})
    row = setup.run(seed=1, index=0).row
    assert row["throw"] == tmp_path.name
    (tmp_path / "one.csv").write_text("t,x,y,z\n0,1,2,3\n")
    with pytest.raises(ValueError, match="one.csv: rows"):
        cb.Setup("paper", throw=str(tmp_path))
