"""The posterior's density as a program: the prior beside NumPy's, where it ends, and what it computes in."""

import re
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from known_likelihoods import Known, linear, simulations
from numpy.testing import assert_allclose

from yeastfit import Prior
from yeastfit.inference.neural_likelihood.densities import densities
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.log_posterior import Ellipsoid, LogPosterior, Program
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.training import train
from yeastfit.inference.posterior.problem import Problem

PRIOR = Prior.of(
    {
        "uniform": {"distribution": "uniform", "low": -1.0, "high": 3.0},
        "log_uniform": {"distribution": "log-uniform", "low": 0.1, "high": 30.0},
        "normal": {"distribution": "normal", "mean": 1.0, "sd": 2.0},
        "cut_normal": {"distribution": "normal", "mean": 1.0, "sd": 0.2, "low": 1.6, "high": 4.0},
        "log_normal": {"distribution": "log-normal", "median": 2.0, "sd": 2.0},
        "cut_log_normal": {"distribution": "log-normal", "median": 1.0, "sd": 0.5, "low": 0.5, "high": 9.0},
        "beta": {"distribution": "beta", "a": 2.0, "b": 1.0, "low": -1.0, "high": 2.0},
        "steep_beta": {"distribution": "beta", "a": 0.5, "b": 3.0},
    }
)


def test_the_prior_is_that_of_numpy() -> None:
    """In double precision, and −inf beyond any end; with a likelihood of 1."""
    program = Program(PRIOR, lambda x: jnp.zeros(len(x)), Ellipsoid.everywhere(8), np.array(1.0))
    x = PRIOR.coordinates(PRIOR.sample(1000, np.random.default_rng(0)))
    assert_allclose(densities(program, x), PRIOR.log_density_of_coordinates(x), rtol=1e-12, atol=1e-12)
    for k, (low, high) in enumerate(PRIOR.support):
        for end, out in ((low, -1e-9), (high, 1e-9)):
            if np.isfinite(end) and not (end == 0.0 and PRIOR.logarithmic[k]):
                beyond = x[:1].copy()
                beyond[0, k] = (np.log(end) if PRIOR.logarithmic[k] else end) + out
                assert densities(program, beyond)[0] == -np.inf


@pytest.fixture(scope="module")
def plane() -> tuple[Known, Emulator]:
    known = linear()
    settings = TrainingSettings(members=3, width=16, steps=200)
    return known, train(
        *simulations(known, 256, seed=0), prior=known.prior, labels=known.labels, seed=0, settings=settings
    )


def test_it_is_prior_times_likelihood_where_that_is_known(plane: tuple[Known, Emulator]) -> None:
    known, emulator = plane
    problem = Problem(known, known.prior, known.observed((1.3, 0.8), 4, seed=1), 4)
    values = known.prior.quantile(np.random.default_rng(0).random((300, 2)))
    x = known.prior.coordinates(values)
    where = Ellipsoid(x.mean(axis=0), np.diag([2.0, 1.0]), np.array(1.0))
    found = LogPosterior(emulator, problem, where, 0.25)(x)
    inside = ((x - x.mean(axis=0)) ** 2 @ [4.0, 1.0]) <= 1.0
    likelihood = emulator.log_likelihood(values, problem.observed, 4)
    assert 20 < inside.sum() < 280
    np.testing.assert_array_equal(np.isfinite(found), inside)
    np.testing.assert_array_equal(where(x), inside)
    assert_allclose(found[inside], (known.prior.log_density_of_coordinates(x) + 0.25 * likelihood)[inside], rtol=1e-6)


def test_where_networks_have_no_density_it_is_minus_infinity(plane: tuple[Known, Emulator]) -> None:
    """Covariances without a root in single precision make nan there."""
    known, emulator = plane
    problem = Problem(known, known.prior, known.observed((1.3, 0.8), 4, seed=1), 4)
    program = LogPosterior(emulator, problem).program
    likelihood = program.likelihood
    nowhere = replace(program, likelihood=lambda x: jnp.where(x[:, 0] > 0, jnp.nan, likelihood(x)))
    x = known.prior.coordinates(known.prior.quantile(np.random.default_rng(0).random((50, 2))))
    np.testing.assert_array_equal(densities(nowhere, x) == -np.inf, x[:, 0] > 0)


def test_networks_compute_in_their_own_precision(plane: tuple[Known, Emulator]) -> None:
    """Chains walk in double precision; matrices of networks in it would take twice as long."""
    known, emulator = plane
    likelihood = emulator.likelihood(known.observed((1.3, 0.8), 4, seed=1), 4)
    with jax.enable_x64(True):
        data = likelihood.u, likelihood.replicates, likelihood.noise
        x = jnp.zeros((1, 2), likelihood.u.dtype)
        said = str(jax.make_jaxpr(jax.vmap(lambda x: likelihood.ensemble.log_likelihood(x, *data)))(x))
    wide = [line for line in said.splitlines() if re.search(r"f64\[\d", line)]
    assert "f32[" in said
    assert not [line for line in wide if "dot_general" in line or "cholesky" in line or "triangular_solve" in line]
