"""Colonies as a `Simulator`: one colony a proposal, its curves the statistics."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from yeastfit.inference.colonies import Colonies
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.parameter_space import ALONE, Space
from yeastfit.inference.targets import Targets
from yeastfit.model.parameters import Parameters


@dataclass(frozen=True)
class ColonySimulator:
    """Grows one colony for each row of λ and measures it as the targets were.

    free: names of λ; the others are held at `fixed`. labels: the targets' points. A colony that runs into a problem of
    the model (`Colonies.problems` counts them) is measured all the same; one that is not finite is a row of nan.
    Rows of any number are grown in blocks of one size, so nothing is compiled twice.
    """

    free: tuple[str, ...]
    labels: tuple[str, ...]
    space: Space
    colonies: Colonies

    @staticmethod
    def of(
        targets: Targets,
        free: tuple[str, ...],
        fixed: Parameters | None = None,
        settings: FitSettings | None = None,
    ) -> "ColonySimulator":
        """Of the data of one condition, in the order of `Targets.values`. Raises `InputError`."""
        settings = settings or FitSettings()
        space = Space.of(free, {ALONE: fixed or Parameters()})
        how = {"dt": settings.dt, "spacing": settings.spacing, "capacity": settings.capacity}
        colonies = Colonies.of(targets, **how)  # type: ignore[arg-type]
        labels = tuple(targets.label(k) for k in range(len(targets.values)))
        return ColonySimulator(space.names, labels, space, colonies)

    def __call__(
        self, values: Float[np.ndarray, "proposal free"], seeds: Int[np.ndarray, " proposal"]
    ) -> Float[np.ndarray, "proposal statistic"]:
        """Curves, one row a proposal; nan throughout where any value is not finite."""
        keys = jax.vmap(jax.random.key)(jnp.asarray(seeds, jnp.uint32))
        curves = self.colonies.grow(self.space.log_parameters(ALONE, np.log(values)), keys)
        return np.where(np.isfinite(curves).all(axis=1, keepdims=True), curves, np.nan)
