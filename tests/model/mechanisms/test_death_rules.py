"""Death by starvation: survival, what is left of a tree, slots, derivatives, and colonies that die out."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import colony_of, context_of, random_tree
from jaxtyping import Array

from reference import mechanisms as plain
from yeastfit.errors import InputError
from yeastfit.model.cells import Cells, cells_of, level_set, weights_of_cells
from yeastfit.model.colony import Colony
from yeastfit.model.interpolation import growth_rate
from yeastfit.model.mechanisms.starvation_death import StarvationDeath, without
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.simulation.simulate import member_keys, simulate

NODES = 2000
NUMERICS = Numerics(domain=4.0, spacing=1.0, dt=0.02, capacity=NODES)
STAY, VANISH = Model(death=StarvationDeath()), Model(death=StarvationDeath("vanish"))
BOTH = pytest.mark.parametrize("model", [STAY, VANISH], ids=["stay", "vanish"])


def aged(model: Model, relaxation: Relaxation, steps: int, rate: float, fed: float = 0.05) -> Colony:
    """Nodes that only die, in nutrient `fed` under a threshold of 0.1: the hazard is rate · (1 − 10 fed)."""
    rng = np.random.default_rng(0)
    colony = model.resumed(colony_of(rng.uniform(-1, 1, (NODES, 2)), random_tree(rng, NODES), numerics=NUMERICS))
    parameters = model.complete(Parameters(death_rate=rate, starvation=0.1))
    return dying(model, relaxation, colony, parameters, jnp.asarray(fed), jnp.asarray(steps))


@eqx.filter_jit
def dying(
    model: Model, relaxation: Relaxation, colony: Colony, parameters: Parameters, fed: Array, steps: Array
) -> Colony:
    def one(_: Array, colony: Colony) -> Colony:
        colony = dataclasses.replace(colony, step=colony.step + 1)
        context = context_of(colony, NUMERICS, relaxation, parameters, local_nutrient=jnp.full(NODES, fed))
        return model.death.deaths(context)

    return jax.lax.fori_loop(0, steps, one, colony)


@BOTH
def test_nodes_survive_as_their_hazard_says(model: Model) -> None:
    """At constant nutrient a share e^(−ht) lives: of whole nodes within four errors, of weights exactly."""
    expected = np.exp(-1.2 * 0.5 * 1.0)
    whole = aged(model, HARD, 50, 1.2)
    living = np.asarray(model.death.living(whole))
    assert set(living.tolist()) == {0.0, 1.0}
    assert abs(living.sum() / NODES - expected) < 4 * np.sqrt(expected * (1 - expected) / NODES)
    assert int(whole.count) == (NODES if model is STAY else living.sum())
    part = aged(model, Relaxation(), 50, 1.2)
    np.testing.assert_allclose(model.death.living(part), expected, rtol=1e-5)


@BOTH
def test_who_is_fed_lives(model: Model) -> None:
    for rate, fed in ((0.0, 0.0), (5.0, 0.1), (5.0, 0.7)):
        np.testing.assert_array_equal(model.death.living(aged(model, HARD, 3, rate, fed)), 1.0)


def test_who_dies_belongs_to_lineages_and_not_to_slots() -> None:
    rng = np.random.default_rng(1)
    colony = VANISH.resumed(colony_of(rng.uniform(-1, 1, (NODES, 2)), [-1] * NODES, numerics=NUMERICS))
    order = rng.permutation(NODES)
    positions, lineages = (jnp.asarray(np.asarray(one)[order]) for one in (colony.positions, colony.lineages))
    mixed = dataclasses.replace(colony, positions=positions, lineages=lineages)
    parameters = VANISH.complete(Parameters(death_rate=9.0))
    left = []
    for one in (colony, mixed):
        after = dying(VANISH, HARD, one, parameters, jnp.asarray(0.0), jnp.asarray(1))
        left.append({tuple(x) for x in np.asarray(after.positions)[: int(after.count)].tolist()})
    assert left[0] == left[1]
    assert len(left[0]) < NODES


def test_the_others_move_up_as_in_the_plain_reading() -> None:
    rng, numerics = np.random.default_rng(2), dataclasses.replace(NUMERICS, capacity=40)
    colony = colony_of(rng.uniform(-1, 1, (30, 2)), random_tree(rng, 30), numerics=numerics)
    gone = np.zeros(40, bool)
    gone[[0, 3, 4, 17, 29]] = True
    after = jax.jit(without)(colony, jnp.asarray(gone))
    positions, parents = plain.without(np.asarray(colony.positions)[:30], np.asarray(colony.parents)[:30], gone[:30])
    assert int(after.count) == 25
    np.testing.assert_array_equal(np.asarray(after.positions)[:25], positions)
    np.testing.assert_array_equal(np.asarray(after.parents)[:25], parents)
    assert not np.asarray(after.weights)[25:].any()
    # cells go with either of their nodes
    cells = jax.jit(cells_of)(after, jnp.asarray(0.7))
    assert int(np.sum(np.asarray(cells.weights) > 0)) == int((parents >= 0).sum())


def test_weights_are_differentiable_in_both_parameters() -> None:
    with jax.enable_x64(True):
        x = np.random.default_rng(3).uniform(-1, 1, (6, 2))
        numerics = dataclasses.replace(NUMERICS, capacity=6)
        for model in (STAY, VANISH):
            colony = model.resumed(colony_of(x, numerics=numerics))

            @jax.jit
            def left(values: Array, model: Model = model, colony: Colony = colony) -> Array:
                parameters = model.complete(Parameters(death_rate=values[0], starvation=values[1]))
                fed = jnp.linspace(0.0, 0.5, 6)
                context = context_of(colony, numerics, Relaxation(), parameters, local_nutrient=fed)
                return model.death.living(model.death.deaths(context))

            at, h = np.array([0.8, 0.33]), 1e-6
            exact = np.asarray(jax.jit(jax.jacfwd(left))(at))
            for i in range(2):
                step = h * np.eye(2)[i]
                up, down = (np.asarray(left(there)) for there in (at + step, at - step))
                np.testing.assert_allclose(exact[:, i], (up - down) / (2 * h), atol=1e-8)
            assert np.abs(exact).max() > 1e-3


GRID = Numerics(domain=4.0, spacing=0.02, dt=0.02, capacity=2)


@BOTH
@pytest.mark.parametrize("share", [1.0, 0.9, 0.5, 0.1, 1e-3])
def test_of_a_cell_that_dies_by_degrees_its_share_covers_and_eats(model: Model, share: float) -> None:
    """Of one ellipse the area π p q, and ∫max(−f, 0) = π p q / 2; of the dead that stay all is covered."""
    colony = model.resumed(colony_of([[0.0, 0.0], [1.0, 0.0]], numerics=GRID))
    name = next(iter(model.death.node_state()))
    weights = jnp.full(2, share if model is VANISH else 1.0)
    colony = dataclasses.replace(colony, weights=weights, node_state={name: jnp.full(2, share)})
    parameters = model.complete(Parameters(aspect_ratio=0.7))

    @eqx.filter_jit
    def sums(colony: Colony) -> tuple[Array, Array]:
        def g(cells: Cells) -> Array:
            return level_set(cells, Relaxation().union, 9.0, -2.0, GRID.spacing, GRID.points)

        cells = model.cells(colony, parameters, Relaxation())
        eating = weights_of_cells(model.death.eating(colony, Relaxation()), colony.parents)
        eaten = jnp.sum(jnp.maximum(-g(dataclasses.replace(cells, weights=eating)), 0.0))
        return jnp.sum(g(cells) <= 0) * GRID.spacing**2, eaten * GRID.spacing**2

    ellipse = np.pi * 0.5 * 0.35
    covered, eaten = sums(colony)
    assert covered == pytest.approx(ellipse * (share if model is VANISH else 1.0), rel=0.02, abs=2e-4)
    assert eaten == pytest.approx(0.5 * ellipse * share, rel=0.01, abs=2e-4)


def test_the_relaxed_dead_eat_nothing_and_free_their_slots() -> None:
    gone = aged(VANISH, Relaxation(), 400, 4.0, 0.0)  # e^(−32) of each
    assert int(gone.count) == 0
    stays = aged(STAY, Relaxation(), 400, 4.0, 0.0)
    assert np.asarray(STAY.death.eating(stays, Relaxation())).max() < 1e-12


def test_derivatives_stay_finite_where_nearly_nobody_lives() -> None:
    """The mean nutrient of nodes that weigh 10⁻³⁰ in all is a quotient whose derivative divides by the square."""
    slope = jax.jit(jax.grad(growth_rate, argnums=1))
    for weight in (0.0, 1e-30, 1e-15, 1.0):
        assert np.isfinite(np.asarray(slope(jnp.asarray([0.2, 0.4]), jnp.full(2, weight)))).all()


def test_a_colony_that_starves_dies_out_and_says_so() -> None:
    numerics = Numerics(domain=8.0, spacing=0.2, dt=0.02, capacity=16)
    values = Parameters(metabolic_rate=20.0, death_rate=50.0, starvation=1.0, mobility=0.1)
    run = simulate(values, member_keys(0, 2), times=[0.5, 2.0], model=VANISH, numerics=numerics, relaxation=HARD)
    assert run.problems == {"died_out": 2}
    assert (np.asarray(run.colony.count) == 0).all()
    assert np.isnan(run.statistics["compactness"][:, -1]).all()  # of no cells
    assert (run.statistics["growth_rate"][:, -1] == 0).all()
    assert run.panels(0)[0].title.startswith("0 cells at ")


def test_what_the_dead_cannot_do_is_refused(unchecked: None) -> None:
    with pytest.raises(InputError, match="dead is 'bury', it must be 'stay' or 'vanish'"):
        StarvationDeath("bury")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"starvation \(c_d\) is 0, it must be finite and above 0"):
        STAY.complete(Parameters(starvation=0.0))
    assert Model.of({"death": {"rule": "starvation", "dead": "vanish"}}).asdict() == VANISH.asdict()
