"""Two ellipses with p = 1, q = 0.9 that part (source figures 2.1 and 2.2), under the minimum and under smoothmin."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from yeastfit.measure.statistics.smooth_statistics import smooth_shape
from yeastfit.model.cells import Cells, level_set

P, Q = 1.0, 0.9


def union(x: ArrayLike, y: ArrayLike, d: float, s: float | None) -> np.ndarray:
    """g at points, written anew."""
    one, other = (((np.asarray(x) - centre) / P) ** 2 + (np.asarray(y) / Q) ** 2 - 1.0 for centre in (-d, d))
    return np.minimum(one, other) if s is None else -s * np.logaddexp(-one / s, -other / s)


def exact(d: float, s: float | None) -> tuple[float, float]:
    """Area and perimeter of {g ≤ 0} from its outline in polar coordinates, around each centre once it is split."""
    area = perimeter = 0.0
    angle = np.linspace(0.0, 2 * np.pi, 4001)
    way = np.cos(angle), np.sin(angle)
    for centre in (0.0,) if union(0.0, 0.0, d, s) < 0 else (-d, d):
        low, high = np.zeros_like(angle), np.full_like(angle, 3.0)
        np.divide(d, np.abs(way[0]), out=high, where=way[0] * centre < -1e-9)
        high = np.minimum(high, 3.0)
        for _ in range(60):  # by bisection, to the last bit
            middle = 0.5 * (low + high)
            inside = union(centre + middle * way[0], middle * way[1], d, s) < 0
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        x, y = high * way[0], high * way[1]
        area += 0.5 * abs(float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])))
        perimeter += float(np.sum(np.hypot(np.diff(x), np.diff(y))))
    return area, perimeter


def measured(d: float, s: float | None, width: float, spacing: float) -> tuple[float, float]:
    """Area and perimeter by the package, K = width."""
    shape = on_grid(d, s, width, spacing)
    return float(shape["area"]), float(shape["perimeter"])


@partial(jax.jit, static_argnames="spacing")
def on_grid(d: Array | float, s: Array | float | None, width: Array | float, spacing: float) -> dict[str, Array]:
    """All statistics of the shape, on so fine a grid."""
    away = jnp.stack([jnp.asarray(d), jnp.zeros_like(d)])
    cells = Cells(
        centres=jnp.stack([-away, away]),
        directions=jnp.array([[1.0, 0.0], [1.0, 0.0]]),
        half_lengths=jnp.full(2, P),
        half_widths=jnp.full(2, Q),
        weights=jnp.ones(2),
    )
    reach = 1.0 + jnp.maximum(0.0 if s is None else 12.0 * s, 4.5 * width)
    points = 2 * round(4.0 / spacing) + 1
    g = level_set(cells, None if s is None else jnp.asarray(s), reach, -4.0, spacing, points)
    return smooth_shape(0.5 + 0.5 * jnp.tanh(-g / width), spacing, 0.0)


PLACES = pytest.mark.parametrize("d", [0.0, 0.6, 1.4])


@PLACES
@pytest.mark.parametrize("s", [None, 0.5, 0.2])
def test_area_and_perimeter_of_parting_ellipses_converge_in_width(d: float, s: float | None, double: None) -> None:
    """h = K / 8 throughout; by about 4 a halving where the outline is smooth, at least by 1.8 where it has corners."""
    truth = np.array(exact(d, s))
    errors = np.array([np.abs(np.array(measured(d, s, width, width / 8)) - truth) for width in (0.4, 0.2, 0.1)])
    smooth = s is not None or d != 0.6
    gains = errors[:-1] / np.maximum(errors[1:], 1e-9)
    assert (errors[-1] / truth < (0.002 if smooth else 0.02)).all()
    assert (gains[errors[1:] / truth > 1e-4] > (3.0 if smooth else 1.7)).all()


@PLACES
@pytest.mark.parametrize("s", [None, 0.5])
def test_area_and_perimeter_of_parting_ellipses_converge_in_spacing(d: float, s: float | None, double: None) -> None:
    """K fixed: the perimeter in second order, the area at once where the level set is smooth."""
    area, perimeter = np.array([measured(d, s, 0.4, h) for h in (0.1, 0.05, 0.025, 0.0125)]).T
    gains = np.abs(np.diff(perimeter))[:-1] / np.abs(np.diff(perimeter))[1:]
    assert (gains > 3.0).all()
    assert np.abs(np.diff(area))[-1] < 1e-4 * area[-1]


def test_where_the_ellipses_part(double: None) -> None:
    """The minimum at d = p; smoothmin where g(0) = (d² / p² − 1) − s log 2 = 0: 1.16 L0, 8.7 µm, at s = 0.5."""

    def splits(s: float | None) -> float:
        saddle: Callable[[float], float] = lambda d: float(union(0.0, 0.0, d, s))  # noqa: E731
        return float(brentq(saddle, 0.1, 2.0))

    assert splits(None) == pytest.approx(P)
    assert splits(0.5) == pytest.approx(np.sqrt(1.0 + 0.5 * np.log(2.0)))
    for s, d in ((None, splits(None)), (0.5, splits(0.5))):
        before, after = (measured(d + shift, s, 0.02, 0.01)[1] for shift in (-0.1, 0.1))
        assert after > before
