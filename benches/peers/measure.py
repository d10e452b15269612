"""Problems in, tables out, and CPU times between."""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

REPETITIONS = 5


def problems() -> dict:
    """The document that the command wrote."""
    return json.loads(Path(sys.argv[1]).read_text())


def write(*tables: tuple) -> None:
    """Title, columns and rows of each table, and the column whose words the page has as columns, if any."""
    names = ["title", "columns", "rows", "across"]
    Path(sys.argv[2]).write_text(json.dumps([dict(zip(names, table, strict=False)) for table in tables]))


def measured(work: Callable[[], object]) -> tuple[object, float]:
    """The result of some work, and the least CPU time of the process in seconds."""
    least_s, result = float("inf"), None
    for _ in range(REPETITIONS):
        began_s = time.process_time()
        result = work()
        least_s = min(least_s, time.process_time() - began_s)
    return result, least_s


def median(values: list[float]) -> float | None:
    """The median, if there is any value."""
    return statistics.median(values) if values else None
