"""JSON that keeps every number."""

import json
import math
import os
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yeastfit import Fit, InputError, Posterior, Sensitivity, Simulation
from yeastfit.commands.posterior_run.watched_simulator import Met
from yeastfit.commands.run_folder import hashes_of, read_run
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.information.design_result import Design
from yeastfit.inference.information.result import Information
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.offlattice.simulation import OfflatticeSimulation
from yeastfit.storage import as_json, from_json, read_json, reads_saved, write_json

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(alphabet="abc"),
    lambda within: st.lists(within) | st.dictionaries(st.text(), within),
)


@pytest.mark.parametrize("text", ["NaN", "Infinity", "-Infinity", "'NaN", "''-Infinity", "'", "'mine'", "nan"])
def test_texts_that_look_like_numbers_stay_texts(text: str) -> None:
    """The name of a condition, say."""
    assert from_json(as_json({text: [text, {"name": text}]})) == {text: [text, {"name": text}]}


def test_files_below_a_folder_have_the_same_names_however_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, elsewhere = tmp_path / "data", tmp_path / "b.png"
    data.mkdir()
    for file in (data / "manifest.csv", data / "a.png", elsewhere):
        file.write_text(file.name)
    monkeypatch.chdir(tmp_path)
    for base in (Path("data"), data, Path("data/../data")):
        found = hashes_of([base / "manifest.csv", data / "a.png", base / "a.png", elsewhere])
        assert list(found) == ["manifest.csv", "a.png", str(elsewhere)]
    assert list(hashes_of([Path("data/manifest.csv"), Path("data/../b.png")])) == ["manifest.csv", "../b.png"]


@given(PLAIN)
def test_plain_data_come_back_as_they_were(data: object) -> None:
    assert from_json(as_json(data)) == data
    assert from_json(as_json(data, indent=2)) == data


def test_what_is_not_finite_is_strict_json_and_comes_back(tmp_path: Path) -> None:
    data = {"errors": np.array([[1.5, np.inf], [-np.inf, np.nan]]), "limit": math.inf, "missing": None, "word": "nan"}
    write_json(tmp_path / "a.json", data)

    def refuse(word: str) -> float:
        raise AssertionError(f"{word} is no JSON")

    strict = json.loads((tmp_path / "a.json").read_text(), parse_constant=refuse)
    assert strict["errors"] == [[1.5, "Infinity"], ["-Infinity", "NaN"]]
    found = read_json(tmp_path / "a.json")
    np.testing.assert_array_equal(np.array(found["errors"], dtype=float), data["errors"])
    assert (found["limit"], found["missing"], found["word"]) == (math.inf, None, "nan")


@pytest.mark.parametrize("one", [np.float64(0.1), np.float32(0.1), jnp.float32(0.1), np.int64(3), np.bool_(True)])
def test_numbers_of_numpy_and_jax_keep_all_digits(one: np.generic) -> None:
    assert from_json(as_json({"value": one})) == {"value": one.item()}


LOADERS = (
    *(Fit.load, Posterior.load, Sensitivity.load, Simulation.load, LeftOut.load, Design.load, Information.load),
    *(Predictive.load, OfflatticeSimulation.load, read_run, Met.load),
)
NONE = (
    b"",
    b"[",
    b"null",
    b"[]",
    b"{}",
    b'"x"',
    b"1",
    b"[" * 20_000,
    b"PK\x03\x04" + bytes(60),
    b"\x93NUMPY",
    b"\xff" * 9,
)


@pytest.mark.parametrize("load", LOADERS, ids=lambda load: load.__qualname__)
def test_what_is_no_result_is_refused_by_the_name_of_its_file(load: Callable[[Path], object], tmp_path: Path) -> None:
    file = tmp_path / "a.file"
    for content in NONE:
        file.write_bytes(content)
        with pytest.raises(InputError, match=r"a\.file: this is no [a-z ]+ that was saved whole \(.+\)") as refused:
            load(file)
        assert "\n" not in str(refused.value)
        assert len(str(refused.value)) < 300 + len(str(tmp_path))
    with pytest.raises(InputError, match="there is no such file"):
        load(tmp_path / "nowhere")
    with pytest.raises(InputError, match="this is no file"):
        load(tmp_path)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        with pytest.raises(InputError, match="pipe: this is no file"):
            load(tmp_path / "pipe")


def test_too_little_memory_is_not_the_fault_of_a_file(tmp_path: Path) -> None:
    @reads_saved("thing")
    def load(path: str | Path) -> None:
        raise MemoryError

    with pytest.raises(MemoryError):
        load(tmp_path / "a")
