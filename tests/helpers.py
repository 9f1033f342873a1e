"""What several tests share: colonies put together by hand, and calls with wrong types."""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from yeastfit.model.colony import Colony, Problems
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
    """Nodes at `positions`; by default a chain of full weight in nutrient 1. The slots left are empty."""
    x = jnp.asarray(positions, dtype=float)
    nodes, empty = x.shape[0], int(numerics.room) - x.shape[0]
    tree = np.arange(nodes) - 1 if parents is None else np.asarray(parents)
    full = jnp.ones(nodes) if weights is None else jnp.asarray(weights, dtype=float)
    c = jnp.ones((numerics.points,) * 2) if nutrient is None else jnp.asarray(nutrient, dtype=float)
    lineages = jax.vmap(jax.random.key_data)(jax.random.split(jax.random.key(seed), nodes))
    return Colony(
        positions=jnp.pad(x, ((0, empty), (0, 0))),
        parents=jnp.pad(jnp.asarray(tree), (0, empty), constant_values=-1),
        weights=jnp.pad(full, (0, empty)),
        lineages=jnp.pad(lineages, ((0, empty), (0, 0))),
        count=jnp.asarray(nodes),
        nutrient=c,
        step=jnp.asarray(step),
        problems=Problems.none(),
    )


def context_of(
    colony: Colony,
    numerics: Numerics,
    relaxation: Relaxation | None = None,
    parameters: Parameters | None = None,
    **seen: Any,
) -> Context:
    """What a rule is given of a colony whose nodes all live; `seen` replaces what it sees of it."""
    relaxation = Relaxation() if relaxation is None else relaxation
    context = Context.of(colony, parameters or Parameters(), relaxation, numerics, NoDeath())
    return dataclasses.replace(context, **seen)


def pair(distance: float, angle: float = 0.3, centre: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Two nodes a distance apart, the first in the direction of `angle`."""
    half = 0.5 * distance * jnp.array([jnp.cos(angle), jnp.sin(angle)])
    return jnp.asarray(centre) + jnp.stack([half, -half])


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
