"""JSON that keeps every number."""

import json
import math
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yeastfit.storage import as_json, from_json, read_json, write_json

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(alphabet="abc"),
    lambda within: st.lists(within) | st.dictionaries(st.text(), within),
)


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
