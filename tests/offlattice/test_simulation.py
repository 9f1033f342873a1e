"""`simulate_offlattice`: what it refuses, before anything grows."""

from typing import Any

import numpy as np
import pytest

from yeastfit import InputError
from yeastfit.offlattice import simulate_offlattice

pytest.importorskip("numba")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"seeds": [1.5]}, r"seed is 1.5, it must be a whole number"),
        ({"seeds": [-1]}, r"seed is -1, it must be a whole number"),
        ({"seeds": 1}, r"seeds is 1, it must be a list of them"),
        ({"seeds": "12"}, r"seeds is '12', it must be a list of them"),
        ({"seeds": []}, r"seeds: there are none, need one for each colony"),
        ({"cells": "100"}, r"cells is '100', it must be a whole number of at least 1"),
        ({"cells": True}, r"cells is true, it must be a whole number of at least 1"),
        ({"cells": np.nan}, r"cells is nan, it must be a whole number of at least 1"),
        ({"cells": 0}, r"cells is 0, it must be a whole number of at least 1"),
        ({"cells": 10**12}, r"cells is 1e\+12, which would take"),
        ({"every": 2.5}, r"every is 2.5, it must be a whole number from 1 to 50"),
        ({"every": 51}, r"every is 51, it must be a whole number from 1 to 50"),
        ({"parameters": {"fork": "x"}}, r"fork \(.*\) is 'x', it must be in \[0, 1\]"),
        ({"statistics": "area"}, r"statistics is 'area', it must be a list of names"),
        ({"statistics": ["are"]}, r"statistics: got 'are', need some of "),
    ],
)
def test_wrong_calls(wrong: dict[str, Any], words: str, unchecked: None) -> None:
    call: dict[str, Any] = {"parameters": {}, "seeds": [1], "cells": 50} | wrong
    with pytest.raises(InputError, match=words):
        simulate_offlattice(call.pop("parameters"), call.pop("seeds"), **call)


def test_seeds_of_numpy_are_seeds() -> None:
    one = simulate_offlattice({}, np.array([3, 4], dtype=np.uint64), cells=40)
    two = simulate_offlattice({}, [3, 4], cells=40)
    for ours, theirs in zip(one.colonies, two.colonies, strict=True):
        np.testing.assert_array_equal(ours.x, theirs.x)
