"""Log densities of rows, as compiled programs compute them: in double precision, whatever networks in them compute in.

A density is a function of JAX that is a pytree. Arrays that differ from call to call are leaves of it, and programs are
compiled once for all of them.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

ROWS = 128  # at a time, as each needs several covariances

LogDensity = Callable[[Float[Array, "row coordinate"]], Float[Array, " row"]]


def densities(log_density: LogDensity, rows: Float[np.ndarray, "row coordinate"]) -> Float[np.ndarray, " row"]:
    """Log densities of rows, `ROWS` at a time; one program for any number of them."""
    with jax.enable_x64(True):
        found = [np.asarray(_densities(log_density, one)) for one in in_pieces(rows, ROWS)]
    return np.concatenate(found)[: len(rows)]


@eqx.filter_jit
def _densities(log_density: LogDensity, rows: Float[Array, "row coordinate"]) -> Float[Array, " row"]:
    return log_density(rows)


def in_pieces(rows: Float[np.ndarray, "row *any"], length: int) -> Float[np.ndarray, "piece length *any"]:
    """Rows in pieces of one length; the last piece is filled up from the first row on."""
    count = max(1, -(-len(rows) // length))
    return np.resize(rows, (count, length, *rows.shape[1:]))
