"""Arrays of a pytree apart from the rest of it, once, for functions that are called many thousand times.

`eqx.filter_jit` takes its arguments apart in every call. For a likelihood of 64 walkers that took as long as computing
it; `jax.jit` of the arrays, with the rest as a static argument, takes half the time.
"""

from collections.abc import Hashable
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array


def taken_apart(tree: Any) -> tuple[list[Array], Hashable]:
    """Arrays, and what `put_together` needs besides."""
    arrays, rest = (jax.tree.flatten(one) for one in eqx.partition(tree, eqx.is_array))
    return arrays[0], (arrays[1], tuple(rest[0]), rest[1])


def put_together(arrays: list[Array], rest: Any) -> Any:
    """The pytree."""
    of_arrays, others, of_others = rest
    return eqx.combine(jax.tree.unflatten(of_arrays, arrays), jax.tree.unflatten(of_others, others))
