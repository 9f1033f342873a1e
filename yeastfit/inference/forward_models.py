"""Forward models by name, for the command line: what `yeastfit infer --model NAME` can infer the parameters of.

`FORWARD_MODELS` maps names to what a command needs to know of a model. A new one is an entry here or, from outside the
package, `yeastfit.FORWARD_MODELS["name"] = ForwardModel(...)`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from yeastfit.inference.colony_simulator import DEFAULT_FREE, OUTLINE_PIXEL, ColonySimulator, Resolution
from yeastfit.inference.posterior.prior import Prior
from yeastfit.inference.simulator import Simulator
from yeastfit.inference.targets import Targets
from yeastfit.model.numerics import Numerics
from yeastfit.model.nutrient import check_alpha
from yeastfit.model.parameters import PARAMETERS, Scales
from yeastfit.parameter_set import ParameterSet

FAR = 0.999  # cumulative probability of a prior beyond which there are few draws

Outlines = tuple[list[Bool[np.ndarray, "x y"]], float]


Builder = Callable[[Targets, Sequence[str], Mapping[str, float], Resolution], Simulator]
Drawer = Callable[[Any, Float[np.ndarray, "row free"], Targets, int], Outlines]


def unchecked(prior: Prior, fixed: Mapping[str, float], resolution: Resolution) -> None:
    """Accept every prior."""


@dataclass(frozen=True)
class ForwardModel:
    """A forward model of measured curves.

    Attributes:
        parameters: All of them.
        free: Names of those that are inferred by default.
        simulator: Called with the data of one condition, names of the free parameters, values of the others and a
            resolution; returns a simulator of the data's statistics.
        nouns: What one replicate is called, and several.
        units: A sentence for pages on the units of parameters and statistics.
        outlines: Called with that simulator, rows of parameters, the data and a seed; returns masks of what is
            simulated at the data's last time, and µm per pixel. None where there is nothing to draw.
        check: Raises `InputError` where a prior and held parameters ask for more than the resolution can compute.
    """

    parameters: ParameterSet
    free: tuple[str, ...]
    simulator: Builder
    nouns: tuple[str, str] = ("simulation", "simulations")
    units: str = ""
    outlines: Drawer | None = None
    check: Callable[[Prior, Mapping[str, float], Resolution], None] = unchecked


def _colony_outlines(
    simulator: ColonySimulator, values: Float[np.ndarray, "row free"], targets: Targets, seed: int
) -> Outlines:
    scales = targets.imaging.scales if targets.imaging is not None else Scales()
    return simulator.outlines(values, float(targets.times[-1]), seed), OUTLINE_PIXEL * scales.length


def _check_time_step(prior: Prior, fixed: Mapping[str, float], resolution: Resolution) -> None:
    """Raise `InputError` where the prior reaches a diffusivity for which the time step is too long."""
    largest = fixed.get("diffusivity", PARAMETERS["diffusivity"].default)
    if "diffusivity" in prior.free:
        far = prior.quantile(np.full((1, len(prior.free)), FAR))[0]
        largest = float(far[prior.free.index("diffusivity")])
    spacing = resolution.spacing
    step = Numerics(domain=100 * spacing, spacing=spacing, dt=resolution.dt)
    check_alpha(jnp.asarray(largest, jnp.result_type(float)), step)


FORWARD_MODELS: dict[str, ForwardModel] = {
    "algebraic": ForwardModel(
        parameters=PARAMETERS,
        free=DEFAULT_FREE,
        simulator=ColonySimulator.of,
        nouns=("colony", "colonies"),
        units="Parameters are dimensionless. Statistics are named by their times in units of 1/μ*; lengths are in L0, "
        "areas in L0²; in the picture and in predictive.csv there are hours, too.",
        outlines=_colony_outlines,
        check=_check_time_step,
    ),
}
