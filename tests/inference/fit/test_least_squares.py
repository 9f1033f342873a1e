"""Fits of colonies that were grown with known parameters: curves, masks, and a single image."""

from dataclasses import replace

import numpy as np
import pytest

from yeastfit import FitSettings, Imaging, Numerics, Parameters, Resolution, Targets, fit, member_keys, plot, simulate
from yeastfit.inference.imaging import Estimator
from yeastfit.measure.statistics.model_as_mask import HardStatistics
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.relaxation import HARD

TRUTH = Parameters(mobility=1.5, aspect_ratio=0.6)
FREE = ("mobility", "aspect_ratio")
EXTENT = 2.2
SMALL = FitSettings(screened=32, starts=2, members=(16, 64), spreads=(0.2, 0.15), refined=0)
COARSE = Resolution(dt=0.02, spacing=0.25, capacity=16)


def grown(names: tuple[str, ...], times: list[float], replicates: int, estimator: Estimator, seed: int) -> Targets:
    """Of hard colonies of up to 16 nodes, at a time step and on a grid that the fit does not use."""
    numerics = Numerics(domain=12.0, spacing=0.2, dt=0.01, capacity=16)
    smooth = estimator == "smooth"
    observe = SmoothStatistics(6.0, 0.1, 0.15) if smooth else HardStatistics(6.0, 0.1, names)
    keys = member_keys(seed, replicates)
    run = simulate(TRUTH, keys, times=times, numerics=numerics, relaxation=HARD, observe=observe)
    curves = {name: np.asarray(run.statistics[name], dtype=float) for name in names}
    imaging = Imaging(EXTENT, estimator, spacing=0.1, smoothing=0.15 if smooth else 0.0)
    return Targets.from_replicates(curves, np.array(times), imaging=imaging)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("names", "estimator"), [(("compactness", "radius", "area"), "smooth"), (("outer_compactness", "area"), "mask")]
)
def test_a_fit_recovers_what_colonies_were_grown_with(names: tuple[str, ...], estimator: Estimator) -> None:
    result = fit(grown(names, [1.8, 2.5, 3.0], 10, estimator, 77), free=FREE, seed=2, settings=SMALL, resolution=COARSE)
    for name in FREE:
        value, error = result.values[name], result.standard_errors[name]
        if estimator == "smooth" or np.isfinite(error):
            assert abs(np.log(value / float(getattr(TRUTH, name)))) < 3 * error / value
    assert result.standard_errors["aspect_ratio"] < 0.15 * result.values["aspect_ratio"]
    assert result.converged
    assert result.chi_square < result.degrees_of_freedom + 4 * np.sqrt(2 * result.degrees_of_freedom)


@pytest.mark.thorough
def test_a_single_image_of_one_colony_is_enough_for_a_fit() -> None:
    """Its scatter is not known, the model's is taken; errors are wide, and hold the truth."""
    image = grown(("outer_compactness", "area", "radius"), [3.0], 1, "mask", 5)
    assert np.isnan(image.scatter).all()
    assert image.mean.shape == (3, 1)
    settings = replace(SMALL, members=(16, 64), max_steps=5)
    prior = {"mobility": (1.0, 0.7)}  # one image does not tell both of them
    result = fit(image, free=FREE, prior=prior, seed=3, settings=settings, resolution=COARSE)
    ratio, error = result.values["aspect_ratio"], result.standard_errors["aspect_ratio"]
    assert np.isfinite(error)
    assert abs(np.log(ratio / 0.6)) < 3 * error / ratio
    assert abs(np.log(result.values["mobility"] / 1.5)) < 3 * 0.7
    assert result.degrees_of_freedom == 3 + 1 - 2
    assert plot.fit(result).axes
