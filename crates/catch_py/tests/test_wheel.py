"""What is installed beside the code."""

from __future__ import annotations

import importlib.metadata
import json

import catchingbot as cb


def test_the_wheel_lists_the_licences_of_all_crates():
    package = importlib.metadata.distribution("catchingbot")
    assert package.version == cb.__version__
    [listed] = [file for file in package.files if file.name.endswith(".cyclonedx.json")]
    crates = json.loads(listed.read_text())["components"]
    assert len(crates) > 100 and {"pyo3", "numpy", "nalgebra"} <= {crate["name"] for crate in crates}
    assert all(crate["licenses"] for crate in crates)


def test_the_package_is_typed():
    names = {file.name for file in importlib.metadata.files("catchingbot")}
    assert "catchingbot.pth" in names or {"py.typed", "_catchingbot.pyi"} <= names
