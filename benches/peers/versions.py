"""Versions of the peers."""

import platform
from importlib.metadata import version
from pathlib import Path

from measure import write

names = [line.split("==")[0] for line in (Path(__file__).parent / "requirements.txt").read_text().split()]
write(("Versions", ["package", "version"], [["Python", platform.python_version()], *([name, version(name)] for name in names)]))
