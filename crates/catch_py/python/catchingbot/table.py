"""Tables of evaluations."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from catchingbot import _catchingbot


class Table(dict[str, np.ndarray]):
    """The columns of an evaluation by name, a row for each throw: ``polars.DataFrame(table)``, ``pandas.DataFrame(table)``.

    A missing number is NaN and a missing text is empty. ``jsonl`` holds the rows as ``catchingbot eval`` writes them.
    """

    jsonl: bytes

    def __init__(self, columns: Mapping[str, np.ndarray], jsonl: bytes) -> None:
        super().__init__(columns)
        self.jsonl = jsonl

    @classmethod
    def from_jsonl(cls, jsonl: bytes) -> Table:
        """Creates the table from the rows of a ``trials.jsonl`` of ``catchingbot eval``, or of several in sequence."""
        return cls(_catchingbot.columns(jsonl), jsonl)

    def parquet(self) -> bytes:
        """Returns the file ``trials.parquet`` that ``catchingbot eval`` writes of these rows."""
        return _catchingbot.parquet(self.jsonl)

    def rows(self) -> list[dict[str, Any]]:
        """Returns the rows as dicts, with the fields that the columns leave out."""
        return [json.loads(line) for line in self.jsonl.splitlines()]

    def __reduce__(self) -> tuple[Any, ...]:
        return Table, (dict(self), self.jsonl)

    def __repr__(self) -> str:
        caught = self["caught"]
        return f"<Table: {int(caught.sum())} of {len(caught)} caught>"
