"""A nutrient in a dish, alone or beside another field: steps, what is lost, and a dish too wide to matter."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import scattered_tree

from reference import colony as plain_colony
from reference import mechanisms as plain
from yeastfit.model.colony import Colony
from yeastfit.model.mechanisms.dish_medium import DishMedium
from yeastfit.model.mechanisms.morphogen_medium import MorphogenMedium
from yeastfit.model.mechanisms.nitrogen_medium import NitrogenMedium
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD
from yeastfit.model.rules import MediumRule
from yeastfit.model.simulate import step
from yeastfit.simulation.simulate import member_keys, simulate

NUMERICS = Numerics(domain=6.0, spacing=0.5, dt=0.02, capacity=24)
HUNGRY = Parameters(metabolic_rate=8.0, diffusivity=0.4)
PLAIN = (
    plain_colony.Parameters(metabolic_rate=8.0, diffusivity=0.4, aspect_ratio=float(HUNGRY.aspect_ratio)),
    plain_colony.Numerics(domain=6.0, spacing=0.5, dt=0.02, capacity=24),
)
DISH = Model(medium=DishMedium())


@eqx.filter_jit
def next_of(model: Model, colony: Colony, numerics: Numerics) -> Colony:
    return step(colony, model.complete(HUNGRY), HARD, numerics, model)[0]


@pytest.mark.parametrize(
    "medium",
    [DishMedium(), NitrogenMedium(carbon_boundary="dish"), MorphogenMedium("dish")],
    ids=["alone", "nitrogen", "morphogen"],
)
def test_a_step_is_the_plain_readings_and_what_is_eaten_is_gone(double: None, medium: MediumRule) -> None:
    """The wall is near: 50 steps, each from where the last ended."""
    model = Model(medium=medium)
    colony, gone = model.resumed(scattered_tree(9, 2.5, NUMERICS)), 0.0
    held = float(colony.nutrient.sum())
    for _ in range(50):
        nodes, before = (np.asarray(colony.positions)[:9], np.asarray(colony.parents)[:9]), np.asarray(colony.nutrient)
        colony = next_of(model, colony, NUMERICS)
        rate = plain_colony.biomass(plain_colony.level_set(*nodes, *PLAIN), PLAIN[0])
        after = plain.closed_step(before, rate, np.zeros_like(rate), 0.4, NUMERICS.spacing, NUMERICS.dt)
        np.testing.assert_allclose(colony.nutrient, after, atol=2e-6)
        gone += NUMERICS.dt * float(np.sum(rate * 0.5 * (before + np.asarray(colony.nutrient))))
    assert float(colony.nutrient.sum()) + gone == pytest.approx(held, rel=1e-5)
    assert gone > 0.15 * held
    assert float(colony.nutrient[0, 6]) < 0.99  # at the wall, too


@pytest.mark.thorough
def test_in_a_wide_dish_the_colony_is_the_sources() -> None:
    wide = dataclasses.replace(NUMERICS, domain=40.0)
    dish = source = scattered_tree(9, 2.5, wide)
    for _ in range(10):
        dish, source = next_of(DISH, dish, wide), next_of(Model(), source, wide)
    np.testing.assert_allclose(dish.nutrient, source.nutrient, atol=2e-6)
    np.testing.assert_allclose(dish.positions, source.positions, atol=2e-6)
    assert float(jnp.min(dish.nutrient)) < 0.8


@pytest.mark.thorough
def test_growth_slows_as_a_dish_is_eaten_empty() -> None:
    """The source's colony goes on at the wall's nutrient."""
    numerics = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=512)
    values, keys = Parameters(metabolic_rate=4.0, diffusivity=0.5), member_keys(0, 3)
    grown = {}
    for model in (DISH, Model()):
        run = simulate(values, keys, times=[4, 9.5], model=model, numerics=numerics, relaxation=HARD)
        counts = np.asarray(run.statistics["cell_count"])
        grown[model.medium.name] = counts[:, 1] / counts[:, 0]
        most = float(jnp.max(run.colony.nutrient))
        assert (most < 0.9) == (model is DISH)
    assert (grown["dish"] < 0.4 * grown["nutrient"]).all()
