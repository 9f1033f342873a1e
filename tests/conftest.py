"""For all tests: shapes are checked at run time, programs are compiled fast and kept, real micrographs are found."""

import gc
import os
import shutil
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import jax
import jaxtyping
import pytest
from PIL import Image
from threadpoolctl import threadpool_limits
from typechecking import check_when_called

# Half of what the tests take is compiling, and most programs run once: XLA's older code generator, its first level of
# optimisation, modules in one part and loops that are not vectorised compile faster. What users run is tested by those
# marked users_compiler: `XLA_FLAGS= pytest -m users_compiler`, a part of `make test-thorough`.
QUICK = (
    "--xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=1 --xla_llvm_disable_expensive_passes=true"
    " --xla_cpu_parallel_codegen_split_count=1"
)
if version("jaxlib").startswith("0.10."):  # with a flag that it does not know, jaxlib ends the process
    os.environ.setdefault("XLA_FLAGS", QUICK)
# Folders and files of tests whose programs run a second or less: not optimised at all.
ONCE = (
    *("measure", "model", "simulation", "report", "test_app.py", "test_models.py", "test_extending.py"),
    "test_colony_simulator.py",
)

# Either core has its own tests: further threads for matrices as small as these mostly wait, and waiting takes a core.
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # of processes that are started from here
threadpool_limits(1, user_api="blas")  # of what this one has loaded

# What one process of a run has compiled, tests or programs that they start, the others need not. A folder given by
# JAX_COMPILATION_CACHE_DIR is kept, so that a second run compiles only what has changed.
OWN_FOLDER = "PYTEST_XDIST_WORKER" not in os.environ and "JAX_COMPILATION_CACHE_DIR" not in os.environ
if OWN_FOLDER:
    os.environ["JAX_COMPILATION_CACHE_DIR"] = tempfile.mkdtemp(prefix="yeastfit-tests-")
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
PROGRAMS = os.environ["JAX_COMPILATION_CACHE_DIR"]
if os.environ.get("XLA_FLAGS") == QUICK:  # numba compiles fast, too; what it keeps of that is not for users
    OF_TESTS = Path(__file__).parents[1] / "build" / "numba-tests"
    os.environ.update(NUMBA_OPT="1", NUMBA_LOOP_VECTORIZE="0", NUMBA_CACHE_DIR=str(OF_TESTS))
jax.config.update("jax_compilation_cache_dir", PROGRAMS)
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_debug_nans", False)
jaxtyping.jaxtyped = check_when_called  # type: ignore[assignment]  # what the hook decorates functions with
jaxtyping.install_import_hook("yeastfit", "typechecking.check")


def pytest_configure(config: pytest.Config) -> None:
    """jax writes its files in place: a process that reads half of one says so, and compiles."""
    config.addinivalue_line("filterwarnings", "ignore:Error reading persistent compilation cache entry")


def pytest_collection_finish() -> None:
    """What is imported stays, and tracing leaves little to collect: looking for it took a seventh of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Without optimisation programs compile in half the time and run five times as long."""
    here = not set(ONCE).isdisjoint(item.path.relative_to(Path(__file__).parent).parts)
    once = here and item.get_closest_marker("runs_long") is None
    jax.config.update("jax_disable_most_optimizations", once and os.environ.get("XLA_FLAGS") == QUICK)


def pytest_unconfigure() -> None:
    """Nothing is left behind."""
    if OWN_FOLDER:
        shutil.rmtree(PROGRAMS)


@pytest.fixture
def double():
    """Double precision for one test."""
    with jax.enable_x64(True):
        yield


@pytest.fixture
def unchecked() -> Iterator[None]:
    """Types are not checked in one test: of a function that is called thousands of times, one in another test is."""
    from helpers import wrong_types  # not before the hook that checks what it imports

    with wrong_types():
        yield


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of one point, where they are not the matter: to draw them takes most of a small run."""
    from yeastfit import plot  # not before the hook that checks what it imports

    monkeypatch.setattr(plot, "save", lambda figure, path: Image.new("L", (1, 1)).save(path, "PNG"))


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real micrographs, from YEASTFIT_REAL or ../shared/real."""
    folder = Path(os.environ.get("YEASTFIT_REAL", Path(__file__).parents[2] / "shared" / "real"))
    if not (folder / "raw").is_dir():
        pytest.skip(f"no real micrographs: set YEASTFIT_REAL ({folder} has no folder raw)")
    return folder
