"""Mechanisms of one's own, written with public names only: simulated, saved, synthesised, differentiated, refused."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import wrong_types
from jaxtyping import Array

from yeastfit import (
    HARD,
    RULES,
    BirthRule,
    Births,
    BuddingRule,
    Context,
    InputError,
    Model,
    Numerics,
    Parameter,
    Parameters,
    Simulation,
    check_gradients,
    member_keys,
    simulate,
)
from yeastfit.inference.colony_curves import ColonyCurves
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.simulate import Schedule
from yeastfit.simulation.recipe import Recipe, read_recipes
from yeastfit.simulation.synthetic_data import synthesize

NUMERICS = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=40)


class TowardsFood(BuddingRule):
    """φ uniform on arg ∇c ± π / (1 + κ): the source's rule at κ = 0."""

    name: ClassVar[str] = "towards food"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("food_bias", "κ", "how closely buds follow the nutrient", (0.01, 100.0), 0.0, largest=1e3),
    )

    def angles(self, context: Context, parents: Array, lineages: Array) -> Array:
        slope = context.local_gradient()[parents]
        steep = jnp.sum(slope**2, axis=-1, keepdims=True) > 0
        towards = jnp.arctan2(*jnp.where(steep, slope, jnp.array([1.0, 0.0]))[:, ::-1].T)
        draw = jax.vmap(lambda data: jax.random.uniform(jax.random.wrap_key_data(data), minval=-1.0))(lineages)
        return towards + jnp.pi * draw / (1.0 + context.parameters["food_bias"])


class Clocks(BirthRule):
    """A node's phase grows by c Δt and it buds at ln 2, times a factor that is a setting; the children start at 0."""

    name: ClassVar[str] = "own clocks"
    cycle: float = 1.0

    def node_state(self) -> dict[str, float]:
        return {"phase": 0.0}

    def advance(self, context: Context) -> dict[str, Array]:
        step = context.numerics.dt * context.local_nutrient
        return {"phase": context.colony.node_state["phase"] + jnp.where(context.colony.alive, step, 0.0)}

    def due(self, context: Context) -> Array:
        return jnp.any(self._ripe(context))

    def births(self, context: Context) -> Births:
        order, ripe = jnp.argsort(~self._ripe(context)), self._ripe(context)
        phase = context.colony.node_state["phase"]
        state = {"phase": jnp.where(ripe, 0.0, phase)}
        return Births(order, jnp.where(ripe, context.living, 0.0)[order], context.colony.step, state)

    def _ripe(self, context: Context) -> Array:
        return context.colony.alive & (context.colony.node_state["phase"] >= self.cycle * jnp.log(2.0))


MODEL = Model(births=Clocks(), budding=TowardsFood())


@pytest.fixture(autouse=True, scope="module")
def unchecked() -> Iterator[None]:
    """Statistics that are traced are no NumPy arrays, as they are annotated to be."""
    with wrong_types():
        yield


@pytest.fixture(scope="module")
def grown() -> Simulation:
    return simulate(
        Parameters(food_bias=4.0, metabolic_rate=0.2),
        member_keys(1, 3),
        times=[1.0, 2.5],
        model=MODEL,
        numerics=NUMERICS,
    )


@pytest.mark.thorough
def test_it_is_simulated_with_the_parameters_that_it_brings(grown: Simulation) -> None:
    """With clocks a well fed colony doubles every ln 2 or a little later, at no common time."""
    assert MODEL.parameters.names == (*Model().parameters.names, "food_bias")
    assert float(grown.parameters["food_bias"]) == 4.0
    assert (np.asarray(grown.colony.count) == [16, 16, 16]).all()
    phases = np.asarray(grown.colony.node_state["phase"])
    assert (phases[:, :16] < np.log(2.0)).all()
    assert phases[:, :16].max() > 0.1
    assert (phases[:, 16:] == 0).all()
    both = simulate(Parameters(), member_keys(1, 3), times=[2.5], model=MODEL, numerics=NUMERICS)
    assert float(both.parameters["food_bias"]) == 0.0
    assert np.abs(both.colony.positions - grown.colony.positions).max() > 0.1


@pytest.mark.thorough
def test_the_bias_points_buds_at_the_nutrient() -> None:
    """Right after the first event at t = 1, at δ from the parents: the angle to the slope is that of the formula."""

    def births(bias: float) -> Simulation:
        model = Model(budding=TowardsFood())
        return simulate(Parameters(food_bias=bias), member_keys(0, 6), times=[1.0], model=model, numerics=NUMERICS)

    source = simulate(Parameters(), member_keys(0, 6), times=[1.0], numerics=NUMERICS)
    sharp, even = births(1e3), births(0.0)
    assert (np.asarray(sharp.colony.count) > 2).all()
    np.testing.assert_array_equal(sharp.colony.lineages, source.colony.lineages)
    for run, least, most in ((sharp, 0.9, 1.0), (even, -1.0, 0.9)):
        cosines = []
        for member in range(6):
            x, parent = np.asarray(run.colony.positions[member]), int(run.colony.parents[member, 2])
            bud, outward = x[2] - x[parent], x[parent] - x[1 - parent]  # the other node has eaten the nutrient there
            cosines.append(bud @ outward / np.linalg.norm(bud) / np.linalg.norm(outward))
        assert least <= min(cosines) <= most


def test_it_goes_on_from_a_saved_colony_as_if_it_had_never_stopped(grown: Simulation, tmp_path: Path) -> None:
    grown.save(tmp_path / "run.npz")
    loaded = Simulation.load(tmp_path / "run.npz", model=MODEL)
    assert loaded.model.asdict()["births"] == {"rule": "own clocks", "cycle": 1.0}
    assert loaded.parameters.asdict() == grown.parameters.asdict()
    np.testing.assert_array_equal(loaded.colony.node_state["phase"], grown.colony.node_state["phase"])
    begun = simulate(loaded.parameters, start=loaded.colony, times=[3.0], model=MODEL, numerics=NUMERICS)
    more = simulate(loaded.parameters, member_keys(1, 3), times=[2.5, 3.0], model=MODEL, numerics=NUMERICS)
    np.testing.assert_array_equal(begun.colony.count, more.colony.count)
    np.testing.assert_allclose(begun.colony.positions, more.colony.positions, atol=1e-5)
    with pytest.raises(InputError, match="births: rule 'own clocks' is unknown, expected one of global"):
        Simulation.load(tmp_path / "run.npz")
    with pytest.raises(InputError, match="model has the rules"):
        Simulation.load(tmp_path / "run.npz", model=Model())


@pytest.mark.thorough
def test_the_source_s_colony_goes_on_under_another_rule() -> None:
    source = simulate(Parameters(), member_keys(0, 2), times=[1.5], numerics=NUMERICS)
    later = simulate(Parameters(), start=source.colony, times=[1.6], model=MODEL, numerics=NUMERICS)
    phases = np.asarray(later.colony.node_state["phase"])[np.asarray(later.colony.alive)]
    assert (phases > 0).all()
    assert (phases < 0.11).all()


@pytest.mark.slow
def test_its_derivatives_are_checked() -> None:
    """In its parameter too, which is 0 by default and then moves in units of its plausible range."""
    check = check_gradients(
        Parameters(food_bias=0.5),
        times=[1.1, 2.2],
        model=Model(budding=TowardsFood()),
        numerics=replace(NUMERICS, capacity=10),
    )
    assert check.passed, str(check)
    bias = [c for c in check.comparisons if c.along == "log food_bias" and c.by == "differences"]
    assert max(abs(c.forward) for c in bias) > 1e-3


def test_it_is_synthesised_from_python_and_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    numerics = Numerics(domain=12.0, spacing=0.2, dt=0.02, capacity=40)
    model = Model(births=Clocks(1.5), budding=TowardsFood())
    recipe = Recipe({"food_bias": 3.0}, 5, (4.0,), 2, 1.5, numerics=numerics, model=model)
    synthesize(recipe, tmp_path / "python")
    truth = json.loads((tmp_path / "python" / "truth" / "parameters.json").read_text())
    assert truth["food_bias"] == 3.0
    assert truth["recipe"]["model"]["births"] == {"rule": "own clocks", "cycle": 1.5}

    file = tmp_path / "recipes.toml"
    file.write_text(
        """
        [slow]
        parameters = { food_bias = 3.0 }
        seed = 5
        hours = [4.0]
        replicates = 2
        pixel_size = 1.5
        numerics = { domain = 12.0, spacing = 0.2, dt = 0.02, capacity = 40 }
        [slow.model]
        births = { rule = "own clocks", cycle = 1.5 }
        budding = { rule = "towards food" }
        """
    )
    with pytest.raises(InputError, match=r"recipes.toml, \[slow\]: births: rule 'own clocks' is unknown"):
        read_recipes(file)
    monkeypatch.setitem(RULES["births"], "own clocks", Clocks())
    with pytest.raises(InputError, match=r"births: rule 'own clocks' is registered as an object"):
        read_recipes(file)
    monkeypatch.setitem(RULES["births"], "own clocks", Clocks)
    monkeypatch.setitem(RULES["budding"], "towards food", TowardsFood)
    synthesize(read_recipes(file)["slow"], tmp_path / "file")
    for name in ("images/colony01_04.0h.tif", "truth/curves.csv", "truth/parameters.json"):
        assert (tmp_path / "file" / name).read_bytes() == (tmp_path / "python" / name).read_bytes()


@pytest.mark.thorough
def test_curves_that_are_fitted_depend_on_its_parameter() -> None:
    """As every sampler sees them: in log λ of all the model's parameters, where a bias of 0 is the source's rule."""
    how = ("mean_radius", "cell_count"), NUMERICS, SmoothStatistics(8.0, 0.2), HARD, Schedule.of([60])
    keys, values = member_keys(0, 3), Parameters(food_bias=100.0)
    z = jnp.log(values.to_array(MODEL.parameters.names))
    source = ColonyCurves(*how).members(z[:-1], keys)
    biased = ColonyCurves(*how, Model(budding=TowardsFood()))
    assert np.abs(biased.members(z, keys)[:, 0] - source[:, 0]).min() > 1e-4
    np.testing.assert_array_equal(biased.members(z, keys)[:, 1], source[:, 1])
    assert np.isfinite(biased.members(z.at[-1].set(-jnp.inf), keys)).all()


@pytest.mark.parametrize(
    ("rules", "words"),
    [
        ({"buding": {"rule": "uniform"}}, "model: question 'buding' is unknown, expected some of births, budding"),
        ({"budding": {"rule": "sideways"}}, "budding: rule 'sideways' is unknown, expected one of uniform"),
        ({"budding": "uniform"}, "budding is 'uniform', expected a table that names its rule"),
        ({"budding": {"rule": "uniform", "bias": 2.0}}, "budding: rule 'uniform' has no setting 'bias', it has none"),
        ({"budding": {"rule": "turned"}}, "budding: rule 'turned': .*turns"),
        ({"death": {"rule": ["starvation"]}}, r"death: rule \['starvation'\] is unknown, expected one of none"),
        ({"births": {"rule": "walkers", "per_bud": 2.5}}, "per_bud of rule 'walkers' is 2.5, expected a whole number"),
        ({"births": {"rule": "collocated", "nodes": True}}, "nodes of rule 'collocated' is true, expected a whole"),
        ({"medium": {"rule": "walkers", "width": float("inf")}}, "width of rule 'walkers' is inf, expected a finite"),
        ({"contact": {"rule": "cells", "union": "a"}}, "union of rule 'cells' is 'a', expected a finite number"),
    ],
)
def test_what_is_no_rule_is_named(rules: dict, words: str) -> None:
    with pytest.raises(InputError, match=words) as raised:
        Model.of(rules)
    assert "\n" not in str(raised.value)


def test_a_parameter_that_no_rule_has_is_named() -> None:
    with pytest.raises(InputError, match=r"budding_bias is a parameter of budding 'biased' or .*: choose that rule"):
        simulate(Parameters(budding_bias=1.0), member_keys(0, 1), times=[0.1], numerics=NUMERICS)
    with pytest.raises(InputError, match=r"food_bias \(κ\) is -1, it must be in \[0, 1000\]"):
        simulate(Parameters(food_bias=-1.0), member_keys(0, 1), times=[0.1], model=MODEL, numerics=NUMERICS)


def test_a_rule_answers_its_own_question_only() -> None:
    with pytest.raises(InputError, match=r"births is TowardsFood.*, it must be of the class BirthRule"):
        Model(births=TowardsFood())  # type: ignore[arg-type]


def test_two_rules_may_not_keep_one_state() -> None:
    class Phase(TowardsFood):
        def node_state(self) -> dict[str, float]:
            return {"phase": 1.0}

    with pytest.raises(InputError, match="two of its rules keep a node state 'phase'"):
        Model(births=Clocks(), budding=Phase())
