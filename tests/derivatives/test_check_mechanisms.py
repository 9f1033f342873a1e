"""Derivatives through whole colonies of the rules that allow it, in the parameters that these bring."""

from collections.abc import Iterator
from typing import Any

import pytest
from helpers import wrong_types

from yeastfit import GradientCheck, Numerics, Parameters, check_gradients
from yeastfit.model.model import Model

TINY = Numerics(domain=6.0, spacing=0.2, dt=0.02, capacity=10)
PATHS: dict[str, tuple[dict[str, Any], dict[str, float]]] = {
    "directions": (
        {"budding": {"rule": "polar"}},
        {"budding_bias": 1.5, "polarity": 0.6},
    ),
    "everything random": (
        {
            "budding": {"rule": "biased"},
            "death": {"rule": "starvation"},
            "motion": {"rule": "langevin"},
            "fluctuations": {"rule": "lognormal"},
        },
        {"budding_bias": 2.0, "death_rate": 0.3, "starvation": 0.9, "node_noise": 0.005, "nutrient_noise": 0.03},
    ),
    "cells in contact": ({"contact": {"rule": "cells"}}, {"overlap_stiffness": 20.0}),
    "blocky cells": ({"shape": {"rule": "superellipse"}}, {"shape_exponent": 4.0}),
    "the dead vanish": (
        {"death": {"rule": "starvation", "dead": "vanish"}},
        {"death_rate": 0.3, "starvation": 0.9},
    ),
}
"""Rules and values of what they bring."""


@pytest.fixture(autouse=True, scope="module")
def unchecked() -> Iterator[None]:
    """Statistics that are traced are no NumPy arrays, as they are annotated to be."""
    with wrong_types():
        yield


def checked(name: str) -> tuple[GradientCheck, dict[str, float]]:
    """The check of one of `PATHS`, through an event of budding."""
    rules, values = PATHS[name]
    check = check_gradients(
        Parameters(**values), model=Model.of(rules), times=(1.1, 1.6), numerics=TINY, draws=1, key=1
    )
    return check, values


@pytest.mark.slow  # minutes, of compiling mostly
@pytest.mark.parametrize("name", PATHS)
def test_colonies_are_differentiable_in_what_rules_bring(name: str) -> None:
    check, values = checked(name)
    assert check.passed, str(check)
    for parameter in values:
        compared = [c for c in check.comparisons if c.by == "differences" and c.along == f"log {parameter}"]
        assert compared
        assert max(abs(c.forward) for c in compared) > 1e-5  # it moves something
