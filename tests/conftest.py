"""Shapes are checked at run time, and the real micrographs are found, for all tests."""

import os
from pathlib import Path

import jax
import pytest
from jaxtyping import install_import_hook

jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_debug_nans", False)
install_import_hook("yeastfit", "typechecking.check")


@pytest.fixture
def double():
    """Double precision for one test."""
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real micrographs, from YEASTFIT_REAL or ../shared/real."""
    folder = Path(os.environ.get("YEASTFIT_REAL", Path(__file__).parents[2] / "shared" / "real"))
    if not (folder / "raw").is_dir():
        pytest.skip(f"no real micrographs: set YEASTFIT_REAL ({folder} has no folder raw)")
    return folder
