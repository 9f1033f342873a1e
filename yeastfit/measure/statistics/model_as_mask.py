"""Statistics of the black-and-white image of a simulated colony, as a micrograph's are taken: not differentiable."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Shaped

from yeastfit.measure.statistics.shape import check_names, mask_statistics
from yeastfit.measure.statistics.smooth_statistics import node_statistics
from yeastfit.model.cells import cells_of, level_set
from yeastfit.model.colony import Colony
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Snapshot

SHAPE_STATISTICS = ("compactness", "radius", "area", "perimeter", "outer_perimeter", "outer_compactness")


def mask_of(
    colony: Colony, aspect_ratio: Float[Array, ""], relaxation: Relaxation, width: float, points: int
) -> Bool[np.ndarray, "x y"]:
    """Where the cells of one colony are, {g ≤ 0} on so many points along each side of a square around the origin."""
    side = jnp.asarray(width, aspect_ratio.dtype)  # an array: for another width nothing is compiled
    return np.asarray(_mask_of(colony, aspect_ratio, relaxation, side, points))


@eqx.filter_jit
def _mask_of(colony: Colony, ratio: Array, relaxation: Relaxation, width: Array, points: int) -> Bool[Array, "x y"]:
    grid = -0.5 * width, width / (points - 1), points
    return level_set(cells_of(colony, ratio), relaxation.union, relaxation.union_reach, *grid) <= 0


class HardStatistics(eqx.Module):
    """Records {g ≤ 0} while the model runs; `finish` measures it as a mask. Lengths in L0.

    extent: side of the square around the origin that is looked at. spacing: its pixel size. statistics: names out of
    `yeastfit.measure.statistics.UNITS`; only these are computed. Raises `InputError` for another name.
    """

    extent: float = eqx.field(static=True)
    spacing: float = eqx.field(static=True, default=0.1)
    statistics: tuple[str, ...] = eqx.field(static=True, default=SHAPE_STATISTICS)

    def __check_init__(self) -> None:
        check_names(self.statistics)

    def __call__(self, snapshot: Snapshot) -> dict[str, Shaped[Array, "..."]]:
        """The image and what only nodes can tell."""
        points, relaxation = round(self.extent / self.spacing) + 1, snapshot.relaxation
        origin = -0.5 * self.spacing * (points - 1)
        g = level_set(snapshot.cells, relaxation.union, relaxation.union_reach, origin, self.spacing, points)
        return {"mask": g <= 0, **node_statistics(snapshot)}

    def finish(self, observed: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Statistics by name, of the shape of the ensemble and its sample times."""
        masks = observed["mask"]
        batch = masks.shape[:-2]
        unseen = dict.fromkeys(self.statistics, np.nan)  # of a colony that came to nothing
        found = [
            mask_statistics(mask, self.spacing, self.statistics) if mask.any() else unseen
            for mask in masks.reshape(-1, *masks.shape[-2:])
        ]
        measured = {name: np.array([each[name] for each in found]).reshape(batch) for name in self.statistics}
        return {**measured, **{name: values for name, values in observed.items() if name != "mask"}}
