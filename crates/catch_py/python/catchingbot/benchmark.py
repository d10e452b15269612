"""Frozen benchmarks: the same throws for everybody.

>>> import catchingbot as cb
>>> result = cb.suite("catch-2026.2").run(trials=1)
>>> result.complete
False
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from catchingbot import _catchingbot
from catchingbot._catchingbot import Setup
from catchingbot.table import Table


class Condition(NamedTuple):
    """An object with a throw in a scenario, and the number of trials."""

    scenario: str
    object: str
    throw: str
    trials: int


@dataclass(frozen=True)
class SuiteResult:
    """All rows of a suite and their hash, equal to that of ``catchingbot suite run`` for the same brain."""

    suite: str
    content_sha256: str
    complete: bool
    table: Table
    rows_sha256: str

    def __repr__(self) -> str:
        part = "" if self.complete else ", a part"
        return f"<SuiteResult {self.suite}{part}: {self.table!r}, rows {self.rows_sha256[:12]}>"


class Suite:
    """A suite with unchanged content since it was frozen."""

    def __init__(self, name: str) -> None:
        said = _catchingbot.suite_file(name)
        self.name, self.description, self.seed = name, said["description"], said["seed"]
        self.content_sha256 = said["content_sha256"]
        self.conditions = [Condition(*it) for it in said["conditions"]]

    def run(
        self,
        *,
        method: str | None = None,
        trials: int | None = None,
        progress: Callable[[int, int], object] | None = None,
        **catching: Any,
    ) -> SuiteResult:
        """Runs all throws, or at most ``trials`` per condition. Other keywords are those of ``Setup.evaluate``: ``brain``, ``predictor``,
        ``planner`` and ``threads``."""
        counts = [it.trials if trials is None else min(it.trials, trials) for it in self.conditions]
        rows: list[bytes] = []
        for i, (condition, count) in enumerate(zip(self.conditions, counts, strict=True)):
            before, total = sum(counts[:i]), sum(counts)
            tell = None if progress is None else lambda done, _, before=before: progress(before + done, total)
            setup = Setup(condition.scenario, object=condition.object, throw=condition.throw, method=method)
            rows.append(setup.evaluate(count, seed=self.seed, progress=tell, **catching).jsonl)
        jsonl = b"".join(rows)
        complete = counts == [it.trials for it in self.conditions]
        return SuiteResult(self.name, self.content_sha256, complete, Table.from_jsonl(jsonl), hashlib.sha256(jsonl).hexdigest())

    def __repr__(self) -> str:
        return f"<Suite {self.name}: {sum(it.trials for it in self.conditions)} throws>"
