"""What several tests share: colonies put together by hand, and calls with wrong types."""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from jaxtyping import Array
from numpy.typing import ArrayLike

from yeastfit.model.colony import Colony, Problems, start
from yeastfit.model.laws.death import NoDeath
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rules import Context


def colony_of(
    positions: ArrayLike,
    parents: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    nutrient: ArrayLike | None = None,
    *,
    numerics: Numerics,
    step: int = 0,
    seed: int = 0,
) -> Colony:
    """Nodes at `positions`; by default a chain of full weight in nutrient 1. The slots left are empty.

    Put together by NumPy, which compiles nothing, but for what is traced.
    """
    nodes = np.shape(positions)[0]
    empty = int(numerics.room) - nodes
    tree = np.arange(nodes) - 1 if parents is None else np.asarray(parents)
    with jax.ensure_compile_time_eval():
        lineages = np.asarray(_lineages(seed, max(64, 1 << (nodes - 1).bit_length())))[:nodes]
    return Colony(
        positions=_padded(positions, ((0, empty), (0, 0))),
        parents=jnp.asarray(np.pad(tree, (0, empty), constant_values=-1)),
        weights=_padded(np.ones(nodes) if weights is None else weights, (0, empty)),
        lineages=jnp.asarray(np.pad(lineages, ((0, empty), (0, 0)))),
        count=jnp.asarray(nodes),
        nutrient=_padded(np.ones((numerics.points,) * 2) if nutrient is None else nutrient, (0, 0)),
        step=jnp.asarray(step),
        problems=Problems.none(),
    )


@partial(jax.jit, static_argnums=1)
def _lineages(seed: int, nodes: int) -> Array:
    """Data of keys, of which the first ones do not depend on how many there are."""
    return jax.random.key_data(jax.random.split(jax.random.key(seed), nodes))


def _padded(values: ArrayLike | Array, by: Any) -> Array:
    if isinstance(values, jax.core.Tracer):
        return jnp.pad(jnp.asarray(values, dtype=float), by)
    return jnp.asarray(np.pad(np.asarray(values, dtype=float), by))


started = eqx.filter_jit(start)
"""A new colony, by one program."""


def scattered_tree(nodes: int, reach: float, numerics: Numerics) -> Colony:
    """A colony of nodes anywhere in a square of side 2 `reach`, each joined to one before it."""
    rng = np.random.default_rng(1)
    return colony_of(rng.uniform(-reach, reach, (nodes, 2)), random_tree(rng, nodes), numerics=numerics)


def context_of(
    colony: Colony,
    numerics: Numerics,
    relaxation: Relaxation | None = None,
    parameters: Parameters | None = None,
    **seen: Any,
) -> Context:
    """What a rule is given of a colony whose nodes all live; `seen` replaces what it sees of it."""
    relaxation = Relaxation() if relaxation is None else relaxation
    context = _seen(colony, parameters or Parameters(), relaxation, numerics, NoDeath())
    return dataclasses.replace(context, **seen)


_seen = eqx.filter_jit(Context.of)


@contextmanager
def on_one_device() -> Iterator[None]:
    """Colonies of an ensemble that grow in segments do so one after the other: each device compiles anew."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "yeastfit.simulation.ensemble_in_segments.on_all_devices",
            lambda grow, members: [jax.tree.map(np.asarray, grow(member)) for member in range(members)],
        )
        yield


def pair(distance: float, angle: float = 0.3, centre: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Two nodes a distance apart, the first in the direction of `angle`."""
    half = 0.5 * distance * np.array([np.cos(angle), np.sin(angle)])
    return np.asarray(centre) + np.stack([half, -half])


def random_tree(rng: np.random.Generator, nodes: int) -> np.ndarray:
    """Parents of a random tree."""
    return np.array([-1] + [int(rng.integers(k)) for k in range(1, nodes)])


def grid(numerics: Numerics) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the nutrient's grid points."""
    axis = -0.5 * numerics.domain + numerics.spacing * np.arange(numerics.points)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    return x, y


@contextmanager
def wrong_types() -> Iterator[None]:
    """Run-time type checks off, as they are for a user, who is to see the package's own message."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        jaxtyping.config.update("jaxtyping_disable", before)
