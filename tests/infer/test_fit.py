"""Fits of simulated curves, and the derivative that drives them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from yeastfit.errors import InputError
from yeastfit.infer.bijection import log_of_free, to_free
from yeastfit.infer.curves import FreeCurves, robust_mean
from yeastfit.infer.fit import FitSettings, fit
from yeastfit.infer.targets import Targets
from yeastfit.measure.smooth import SmoothStatistics
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.model.simulate import Schedule
from yeastfit.simulation import member_keys, simulate

TIMES = np.array([1.5, 2.5, 3.5, 3.9])
TRUTH = Parameters(mobility=1.5, aspect_ratio=0.6)
SMALL = FitSettings(members=32, scouts=64, study=256, max_steps=4)


@pytest.fixture(scope="module")
def targets() -> Targets:
    """Ten hard colonies of up to 15 cells, at a time step and on a grid that the fit does not use."""
    observe = SmoothStatistics(10.0, 0.1, 0.15)
    numerics = Numerics(domain=14.0, spacing=0.1, dt=0.005, capacity=32)
    run = simulate(TRUTH, member_keys(77, 10), times=TIMES, numerics=numerics, relaxation=HARD, observe=observe)
    curves = {name: np.asarray(run.statistics[name], dtype=float) for name in ("compactness", "radius", "area")}
    return Targets.from_replicates(curves, TIMES, spacing=0.1, smoothing=0.15, extent=2.6)


def test_a_fit_recovers_what_the_curves_were_made_with(targets: Targets) -> None:
    stages = []
    free = ("mobility", "aspect_ratio")
    result = fit(targets, free=free, seed=2, settings=SMALL, progress=lambda what, share: stages.append((what, share)))
    for name in free:
        value, error = float(getattr(result.parameters, name)), result.standard_errors[name]
        assert abs(value - float(getattr(TRUTH, name))) < 3 * error
        assert error < 0.3 * value
    assert result.status == "converged"
    assert result.chi_square < 3 * result.degrees_of_freedom
    assert all(0 <= share <= 1 for _, share in stages)
    assert {"study of start 1", "relaxed model", "study 2"} <= {row["stage"] for row in result.history}
    assert result.simulations > 64


def test_more_parameters_than_targets_is_refused(targets: Targets) -> None:
    short = Targets(
        ("radius",), TIMES[:2], targets.mean[:1, :2], targets.scatter[:1, :2], targets.replicates[:2], 0.1, 0.15, 2.6
    )
    with pytest.raises(InputError, match="2 target values cannot determine 3 free parameters"):
        fit(short)


def test_settings_are_checked() -> None:
    with pytest.raises(InputError, match="members is 3"):
        FitSettings(members=3)
    with pytest.raises(InputError, match="starts is 0, it must be at least 1"):
        FitSettings(starts=0)
    with pytest.raises(InputError, match="studies is 1, it must be at least 2"):
        FitSettings(studies=1)


def small_curves() -> tuple[FreeCurves, jax.Array, jax.Array]:
    """Four colonies over two mitosis events."""
    free = ("mobility", "metabolic_rate", "aspect_ratio")
    curves = FreeCurves(
        ("area", "radius"),
        Numerics(domain=10.0, spacing=0.25, dt=0.02, capacity=8),
        SmoothStatistics(8.0, 0.1, 0.15),
        Relaxation(contact=0.2),
        Schedule.of([60, 110]),
        free,
        Parameters(),
    )
    return curves, to_free(Parameters(mobility=1.2, aspect_ratio=0.6), free), member_keys(0, 4)


def test_derivatives_of_curves_against_central_differences() -> None:
    """In double precision, over two mitosis events."""
    jax.clear_caches()  # what single precision has traced of indexing is not traced again, and mixes integer types
    with jax.enable_x64(True):
        curves, z, keys = small_curves()
        free = curves.free
        assert z.dtype == jnp.float64
        push = jax.jacfwd(lambda z: jax.vmap(lambda key: curves.member(z, key))(keys))(z)
        values = jax.jit(lambda z: jax.vmap(lambda key: curves.member(z, key))(keys))
        step = 1e-5
        for k, unit in enumerate(jnp.eye(3)):
            differences = (values(z + step * unit) - values(z - step * unit)) / (2 * step)
            np.testing.assert_allclose(push[..., k], differences, rtol=2e-4, atol=2e-5)
        assert np.isfinite(jax.jacfwd(lambda z: log_of_free(z, free))(z)).all()


def test_the_derivative_of_the_mean_is_the_robust_mean_of_its_members() -> None:
    """Forwards and backwards, as optimistix may ask for it."""
    curves, z, keys = small_curves()
    _, tangents = curves.members_with_tangents(z, keys)
    jacobian = jax.jacfwd(curves.mean)(z, keys)
    np.testing.assert_allclose(jacobian, robust_mean(tangents).mean.T, rtol=1e-5)
    _, pull = jax.vjp(lambda z: curves.mean(z, keys), z)
    np.testing.assert_allclose(pull(jnp.ones(4))[0], jacobian.sum(axis=0), rtol=1e-4)
