"""Simulated colonies of one condition, seen as its data are: hard ones, measured by the targets' estimator."""

from collections import Counter
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.inference.curves import Curves, without_problems
from yeastfit.inference.targets import Targets
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.numerics import Numerics
from yeastfit.model.relaxation import HARD
from yeastfit.simulation.simulate import schedule_of

MOST_NODES = 4096  # capacity, where colonies could in theory grow to more
MARGIN = 3.0  # L0 between a colony and the edge of the dish: several diffusion lengths, nutrient is untouched there


@dataclass
class Colonies:
    """Grows colonies and keeps count of them. grown: how many. problems: what they ran into."""

    curves: Curves
    measured: np.ndarray
    grown: int = 0
    problems: Counter[str] = field(default_factory=Counter)

    @staticmethod
    def of(targets: Targets, *, dt: float, spacing: float, capacity: int | None = None) -> "Colonies":
        """On a dish wide enough, and with room for every cell that could be born by the last time (at most 4096)."""
        times = targets.times
        if times[0] < dt or (np.diff(times) < dt).any():
            raise InputError(f"targets: times are {times}, they must be at least dt = {dt:g} apart: lower dt")
        domain = 2 * spacing * np.ceil((1.3 * targets.extent + MARGIN) / spacing)
        events = int(np.floor(times[-1] + 1e-6))  # a node buds once in a unit of time at most
        room = capacity or min(2 ** (events + 1), MOST_NODES)
        numerics = Numerics(domain=float(domain), spacing=spacing, dt=dt, capacity=room)
        seen = 2.6 * targets.extent
        if targets.estimator == "smooth":
            observe: SmoothStatistics | HardStatistics = SmoothStatistics(
                seen, targets.spacing, targets.smoothing, statistics=targets.names
            )
        else:
            observe = HardStatistics(seen, targets.spacing, targets.names)
        curves = Curves(targets.names, numerics, observe, HARD, schedule_of(times, numerics))
        return Colonies(curves, targets.measured.ravel())

    def grow(self, log_parameters: Float[np.ndarray, "member 7"], keys: Array) -> Float[np.ndarray, "member curve"]:
        """The measured points of each colony's curves."""
        values = np.asarray(self.curves.members(jnp.asarray(log_parameters, jnp.result_type(float)), keys))
        told = np.column_stack([log_parameters, jax.random.key_data(keys)])
        once = np.unique(told, axis=0, return_index=True)[1]  # batches are filled up with copies
        self.grown += len(once)
        self.problems += without_problems(values[once])[1]
        return without_problems(values)[0][:, self.measured]
