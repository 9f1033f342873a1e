"""What numba compiles and keeps: files that cannot be read or written cost time, and nothing else."""

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from yeastfit import compiled

numba = pytest.importorskip("numba")


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of numba's files; what was said is said again."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    compiled._TOLD.clear()
    return tmp_path


def twice() -> Any:
    """A kernel, not yet compiled."""

    def doubled(x: float) -> float:
        return 2.0 * x

    return compiled.kernel(doubled)


def from_files(dispatcher: Any) -> bool:
    """Whether it was read and not compiled."""
    return sum(dispatcher.stats.cache_hits.values()) == 1


def test_what_is_compiled_is_kept(files: Path) -> None:
    first, second = twice(), twice()
    assert first(1.5) == second(1.5) == 3.0
    assert not from_files(first)
    assert from_files(second)
    assert sorted(path.suffix for path in files.rglob("*.nb*")) == [".nbc", ".nbi"]


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize(
    "damage", [lambda held: held[: len(held) // 2], lambda held: b"", lambda held: bytes(64) + held[64:]]
)
def test_a_damaged_file_is_replaced(files: Path, suffix: str, damage: Callable[[bytes], bytes]) -> None:
    twice()(1.5)
    (path,) = files.rglob(f"*{suffix}")
    path.write_bytes(damage(path.read_bytes()))
    for again in (False, True):
        dispatcher = twice()
        assert dispatcher(1.5) == 3.0
        assert from_files(dispatcher) == again


def test_a_full_disk_is_told_of_once(files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(numba.core.caching.IndexDataCacheFile, "_save_data", full)
    with pytest.warns(RuntimeWarning, match=r"cannot be kept in \S+ \(No space left on device\); every run") as told:
        assert twice()(1.5) == twice()(1.5) == 3.0
    assert len(told) == 1
    assert str(files) in str(told[0].message)


def test_without_any_folder_it_is_compiled_each_time(files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.core.caching.CacheImpl, "_locator_classes", [])
    with pytest.warns(RuntimeWarning, match="neither the folder of the package nor numba's own can be written; every"):
        assert twice()(1.5) == 3.0
    assert not any(files.iterdir())
