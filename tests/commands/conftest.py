"""Measurements of known colonies for the tests of `yeastfit infer`."""

from pathlib import Path

import pytest
from known_colonies import write_measurements


@pytest.fixture
def drawn_data(tmp_path: Path) -> Path:
    """Of known colonies."""
    return write_measurements(tmp_path / "data" / "measurements.csv")


@pytest.fixture
def data(drawn_data: Path, undrawn: None) -> Path:
    """For runs whose pictures are not looked at."""
    return drawn_data
