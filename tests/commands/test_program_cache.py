"""Compiled programs between runs: where they are kept, who says otherwise, and what a kill leaves."""

import os
import subprocess
import sys
from pathlib import Path

import platformdirs
import pytest

from yeastfit.commands import app
from yeastfit.commands.console.program_cache import MOST_BYTES, keep_programs

FOLDER, SIZE = "JAX_COMPILATION_CACHE_DIR", "JAX_COMPILATION_CACHE_MAX_SIZE"
SHORTEST = "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"
PROGRAM = """
from yeastfit.commands.console.program_cache import keep_programs
keep_programs()
import jax, jax.numpy as jnp
saved = []
jax.monitoring.register_event_duration_secs_listener(lambda event, *_, **__: saved.append("time_saved" in event))
jax.jit(lambda x: jnp.linalg.qr(jnp.sort(jnp.outer(x, x))))(jnp.arange(9.0))
print(any(saved))
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's cache folder."""
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name, **_: tmp_path / name)
    return tmp_path / "yeastfit"


def test_programs_are_kept_in_a_bounded_folder_of_the_user(place: Path) -> None:
    environment: dict[str, str] = {}
    keep_programs(environment)
    folder = Path(environment[FOLDER])
    assert folder.is_dir()
    assert folder.parents[1] == place
    assert environment[SIZE] == str(MOST_BYTES)
    if os.name == "posix":
        assert folder.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize(("name", "value"), [(FOLDER, "elsewhere"), ("JAX_ENABLE_COMPILATION_CACHE", "0")])
def test_jax_s_own_variables_come_first(name: str, value: str, place: Path) -> None:
    environment = {name: value}
    keep_programs(environment)
    assert environment == {name: value}
    assert not place.exists()


def test_nothing_is_kept_where_nothing_can_be_written(place: Path) -> None:
    place.write_text("a file")
    environment: dict[str, str] = {}
    keep_programs(environment)
    assert environment == {}


def test_half_a_program_is_removed(place: Path) -> None:
    environment: dict[str, str] = {}
    keep_programs(environment)
    folder = Path(environment[FOLDER])
    for name in ("whole-cache", "whole-atime", "half-cache"):
        (folder / name).write_bytes(b"12345678")
    keep_programs({})
    assert {"whole-cache", "whole-atime", "half-cache"} & {each.name for each in folder.iterdir()} == {
        "whole-cache",
        "whole-atime",
    }


@pytest.mark.parametrize("option", ["--cache", "--no-cache"])
def test_an_option_says_whether_programs_are_kept(option: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(app, "keep_programs", lambda: asked.append(True))
    assert app.run([option, "demo", "--help"]) == 0
    assert asked == ([True] if option == "--cache" else [])


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the user's cache folder is not told by a variable")
def test_a_second_process_takes_what_the_first_has_compiled(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    environment |= {"XDG_CACHE_HOME": str(tmp_path), SHORTEST: "0"}  # however fast the processor compiles
    said = []
    for _ in range(2):
        command = [sys.executable, "-W", "error", "-c", PROGRAM]
        said.append(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
    assert said == ["False\n", "True\n"]
