"""The code of the how-to page and of the notebook runs."""

from __future__ import annotations

import ast
import json
import re

import pytest

from conftest import ROOT

def blocks(page: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / "docs/how-to" / page).read_text(), re.DOTALL)


NOTEBOOK = json.loads((ROOT / "examples/notebooks/first_throw.ipynb").read_text())


def test_the_page_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert len(blocks("use-it-from-python.md")) >= 7
    names: dict[str, object] = {}
    for block in blocks("use-it-from-python.md"):
        exec(compile(block, "use-it-from-python.md", "exec"), names)
    assert names["pose"].status == "registered"


def test_the_own_cell_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    [cell] = blocks("own-cell-in-python.md")
    names: dict[str, object] = {}
    exec(compile(cell, "own-cell-in-python.md", "exec"), names)
    assert names["brain"].status == "committed" and names["cell"].width_m < 0.06
    assert (tmp_path / "own_cell.catch").exists()


def test_the_notebook_runs(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib").use("Agg")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    cells = ["".join(cell["source"]) for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]
    assert len(cells) >= 5
    for cell in cells:
        module = ast.parse(cell)
        # As a notebook does: the value of a last expression is shown.
        last = module.body.pop() if isinstance(module.body[-1], ast.Expr) else None
        exec(compile(module, "first_throw.ipynb", "exec"), names)
        if last is not None:
            shown = eval(compile(ast.Expression(last.value), "first_throw.ipynb", "eval"), names)
            if hasattr(shown, "_repr_html_"):
                assert "<iframe" in shown._repr_html_()
    assert names["trial"].caught
    assert all(not cell.get("outputs") for cell in NOTEBOOK["cells"])
