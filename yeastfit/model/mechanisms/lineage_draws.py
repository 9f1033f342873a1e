"""Random numbers of single nodes: a draw belongs to a lineage, a mechanism and a number, and never to a slot."""

import zlib
from typing import cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, Key, UInt32


def keys_of(
    lineages: UInt32[Array, "node 2"], purpose: str, number: Int[Array, "..."] | Int[Array, ""]
) -> Key[Array, " node"]:
    """A random key for each node.

    Arguments:
        lineages: Of the nodes.
        purpose: Names the mechanism, so that two of them draw independently of each other and of lineages.
        number: Of the draw, the time step for instance; one for all nodes or one each.
    """
    tag = zlib.crc32(purpose.encode())

    def key(data: Array, number: Array) -> Array:
        return jax.random.fold_in(jax.random.fold_in(jax.random.wrap_key_data(data), tag), number)

    return cast(Array, jax.vmap(key)(lineages, jnp.broadcast_to(number, lineages.shape[:1])))
