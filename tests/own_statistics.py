"""Statistics that a user might add; processes that `measure` starts can import them from here."""

import jax.numpy as jnp
from jaxtyping import Array

from yeastfit import Statistic
from yeastfit.measure import Indicator, Pixels
from yeastfit.model.snapshot import Snapshot


def side_of_pixels(pixels: Pixels) -> float:
    return float(pixels.area) ** 0.5


def side_of_indicator(indicator: Indicator) -> Array:
    return jnp.sqrt(indicator.area)


def oldest(snapshot: Snapshot) -> Array:
    return jnp.asarray(snapshot.colony.step, float)


SIDE = Statistic(
    "side",
    1,
    "side of the square of the same area",
    mask=side_of_pixels,
    smooth=side_of_indicator,
    measurement_error=0.005,
    reach=4.0,
)
STEPS = Statistic("steps", 0, "steps since the start", "steps done", nodes=oldest, comparable=False)
