"""One private server for the test session, from IPLW_BIN or the latest build in the checkout."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

import iplw

CHECKOUT = Path(__file__).resolve().parents[3]


def pytest_configure() -> None:
    # An installed `iplw` on PATH would have precedence; test the build of this checkout.
    if "IPLW_BIN" not in os.environ:
        built = [CHECKOUT / "target" / profile / "iplw" for profile in ("debug", "release")]
        built = [binary for binary in built if os.access(binary, os.X_OK)]
        if built:
            os.environ["IPLW_BIN"] = str(max(built, key=lambda binary: binary.stat().st_mtime))


@pytest.fixture(scope="session", autouse=True)
def client() -> Iterator[iplw.Client]:
    """A client that keeps the private server alive, so that tests and environments share it."""
    with iplw.Client() as client:
        yield client
