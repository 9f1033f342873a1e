"""Statistics of the black-and-white image of a simulated colony, as a micrograph's are taken: not differentiable."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Shaped

from yeastfit.measure.statistics.measure_mask import measure_mask
from yeastfit.measure.statistics.registry import STATISTICS, check_names, recorded
from yeastfit.measure.statistics.smooth_statistics import node_statistics
from yeastfit.model.cells import level_set
from yeastfit.model.colony import Colony
from yeastfit.model.model import Model
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.snapshot import Snapshot

SOURCE = Model()


def mask_of(
    colony: Colony,
    parameters: Parameters,
    relaxation: Relaxation,
    width: float,
    points: int,
    model: Model = SOURCE,
) -> Bool[np.ndarray, "x y"]:
    """Draw the cells of one colony.

    Arguments:
        colony: Its state.
        parameters: Values of the model's parameters.
        relaxation: Says how cells are joined.
        width: Side of a square around the origin, in L0.
        points: Along each side of it.
        model: The rules.

    Returns:
        Where the cells are, {g ≤ 0}.
    """
    side = jnp.asarray(width, colony.positions.dtype)  # an array: for another width nothing is compiled
    return np.asarray(_mask_of(colony, parameters, relaxation, side, points, model))


@eqx.filter_jit
def _mask_of(
    colony: Colony, parameters: Parameters, relaxation: Relaxation, width: Array, points: int, model: Model
) -> Bool[Array, "x y"]:
    grid = -0.5 * width, width / (points - 1), points
    return level_set(model.cells(colony, parameters, relaxation), relaxation.union, relaxation.union_reach, *grid) <= 0


class HardStatistics(eqx.Module):
    """Records {g ≤ 0} while the model runs; `finish` measures it as a mask. Lengths are in L0.

    Attributes:
        extent: Side of the square around the origin that is looked at.
        spacing: Its pixel size.
        statistics: Names of statistics with a form for masks or for nodes; by default `registry.recorded`. Only these
            are computed.

    Raises:
        InputError: A name is not such a statistic.
    """

    extent: float = eqx.field(static=True)
    spacing: float = eqx.field(static=True, default=0.1)
    statistics: tuple[str, ...] = eqx.field(static=True, default_factory=lambda: recorded("mask"))

    def __check_init__(self) -> None:
        check_names(self.statistics, "mask", "nodes")

    @property
    def sample_size(self) -> float:
        """Bytes of one image."""
        return (self.extent / self.spacing + 1) ** 2

    def __call__(self, snapshot: Snapshot) -> dict[str, Shaped[Array, "..."]]:
        """The image, and what only nodes tell."""
        points, relaxation = round(self.extent / self.spacing) + 1, snapshot.relaxation
        origin = -0.5 * self.spacing * (points - 1)
        g = snapshot.level_set(relaxation.union_reach, origin, self.spacing, points)
        return {"mask": g <= 0, **node_statistics(snapshot, self.statistics)}

    def finish(self, observed: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Statistics by name, of the shape of the ensemble and its sample times; nan of an empty image."""
        masks = observed["mask"]
        batch = masks.shape[:-2]
        names = tuple(name for name in self.statistics if STATISTICS[name].mask)
        empty = dict.fromkeys(names, np.nan)
        found = [
            measure_mask(mask, self.spacing, names) if mask.any() else empty
            for mask in masks.reshape(-1, *masks.shape[-2:])
        ]
        measured = {name: np.array([each[name] for each in found]).reshape(batch) for name in names}
        return {**measured, **{name: values for name, values in observed.items() if name != "mask"}}
