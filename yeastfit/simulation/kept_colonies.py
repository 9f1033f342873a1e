"""Large colonies kept in a folder while they grow, so that growth that was broken off goes on.

    FOLDER/colony_0.npz     the first colony after its last segment, and what was observed until then

A file says by a SHA-256 what it belongs to: everything that the colony follows from, and the versions of the packages.
Growth goes on from a file of the same; any other is as good as none.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from yeastfit.model.colony import Colony
from yeastfit.storage import as_json, versions, written_whole

EVERY = 30.0  # seconds between two files of one colony, at least


def signature_of(*what: PyTree) -> str:
    """The SHA-256 of trees of arrays, with all that is static in them, and of the versions of the packages."""
    leaves, tree = jax.tree.flatten(what)
    found = sha256(f"{tree} {as_json(versions())}".encode())
    for leaf in leaves:
        if not eqx.is_array_like(leaf):
            found.update(repr(leaf).encode())
            continue
        keys = isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        array = np.asarray(jax.random.key_data(leaf) if keys else leaf)
        found.update(f"{array.dtype} {array.shape}".encode() + array.tobytes())
    return found.hexdigest()


@dataclass
class KeptColony:
    """The file of one colony.

    Attributes:
        file: Its path.
        signature: What it belongs to.
    """

    file: Path
    signature: str
    written: float = field(default_factory=time.monotonic, init=False)

    def __call__(self, colony: Colony, observed: Sequence[PyTree]) -> None:
        """Keep a colony, unless that was done less than `EVERY` seconds ago."""
        if time.monotonic() - self.written < EVERY:
            return
        leaves = jax.tree.leaves((colony, list(observed)))
        with written_whole(self.file) as temporary, temporary.open("wb") as file:
            arrays: dict[str, Any] = {f"{k}": np.asarray(leaf) for k, leaf in enumerate(leaves)}
            np.savez(file, signature=self.signature, samples=len(observed), **arrays)
        self.written = time.monotonic()

    def found(self, colony: Colony, shapes: Callable[[Colony], PyTree]) -> tuple[Colony, list[PyTree]]:
        """The colony that is kept, and what was observed until then; the one given, and nothing, where none is.

        Arguments:
            colony: At its start.
            shapes: Of what is observed of a colony.
        """
        try:
            with self.file.open("rb") as opened, np.load(opened) as archive:
                if str(archive["signature"]) != self.signature:
                    return colony, []
                like = colony, [shapes(colony)] * int(archive["samples"])
                leaves, tree = jax.tree.flatten(like)
                return jax.tree.unflatten(tree, [jnp.asarray(archive[f"{k}"]) for k in range(len(leaves))])
        except (OSError, KeyError, ValueError, EOFError, BadZipFile):  # there is none, or it is damaged
            return colony, []
