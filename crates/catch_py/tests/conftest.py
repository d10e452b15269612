"""What tests share: the repository, the program, setups that are made once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import catchingbot as cb

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session")
def program() -> Path:
    """The program `catchingbot`, which CI builds before these tests."""
    path = Path(os.environ.get("CATCHINGBOT", ROOT / "target/release/catchingbot"))
    if not path.exists():
        if os.environ.get("CI"):
            pytest.fail(f"{path} is missing: cargo build --release")
        pytest.skip(f"{path} is missing: cargo build --release")
    return path


@pytest.fixture(scope="session")
def setup() -> cb.Setup:
    return cb.Setup("paper", object="banana", throw="near_sampled")
