"""The level set of a large colony as an operation that numba has compiled, for what is observed of it.

The same as that of `cells`, of points with r² ≤ `reach` alone. It has no derivative.
"""

from dataclasses import fields

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.model.cells import FAR, Scalar, patch_of
from yeastfit.model.compiled.operations import operation, shapes_of
from yeastfit.model.snapshot import Snapshot


class CompiledSnapshot(Snapshot):
    """The same, whose cells are joined by a function that numba has compiled."""

    @staticmethod
    def of(snapshot: Snapshot) -> "CompiledSnapshot":
        """Of the plain one."""
        return CompiledSnapshot(**{one.name: getattr(snapshot, one.name) for one in fields(snapshot)})

    def level_set(self, reach: Scalar, origin: float, spacing: float, points: int) -> Float[Array, "x y"]:
        """g on a square grid; of the hard union where it is below 0."""
        cells, union = self.cells, self.relaxation.union
        if union is None and self.relaxation.boundary is not None:
            return super().level_set(reach, origin, spacing, points)
        dtype = cells.centres.dtype
        numbers = origin, spacing, 0.0 if union is None else union, reach
        shapes, counts = shapes_of(cells)
        sizes = points, *counts, patch_of(spacing)
        shape = jax.ShapeDtypeStruct((points, points), dtype)
        covered = jax.ffi.ffi_call(operation("covering", np.dtype(dtype)), shape)(
            cells.centres,
            cells.directions,
            *shapes,
            cells.weights,
            jnp.stack([jnp.asarray(number, dtype) for number in numbers]),
            jnp.asarray(sizes, jnp.int32),
        )
        reached = covered > 0
        inside = -covered if union is None else -union * jnp.log(jnp.where(reached, covered, 1.0))
        return jnp.where(reached, inside, FAR)
