"""The code of the how-to page runs."""

from __future__ import annotations

import re

import pytest

from conftest import ROOT

PAGE = (ROOT / "docs/how-to/use-it-from-python.md").read_text()
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def test_the_page_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert len(BLOCKS) >= 4
    names: dict[str, object] = {}
    for block in BLOCKS:
        if "import gymnasium" in block:
            pytest.importorskip("gymnasium")
        exec(compile(block, "use-it-from-python.md", "exec"), names)
