"""The batch program lowered for CUDA calls no host and copies no state; one that did would be noticed."""

from typing import Any

import jax
import jax.numpy as jnp
import pytest

from benchmarks.cuda_program import Inspection, Loop, inspected
from benchmarks.programs import samples
from yeastfit.model.numerics import Numerics


@pytest.fixture(scope="module")
def batch() -> Inspection:
    return inspected(2, Numerics(domain=8.0, spacing=0.4, dt=0.025, capacity=16), samples(4, 2))


def loops_of(found: Inspection) -> list[Loop]:
    return [one for one in found.root.all if one.depth]


def test_the_ensemble_calls_no_host_and_copies_no_whole_array_in_a_loop(batch: Inspection) -> None:
    assert batch.host_calls == []
    assert [one.copied for one in loops_of(batch)] == [[] for _ in loops_of(batch)]


def test_the_whole_step_has_been_seen(batch: Inspection) -> None:
    assert max(one.depth for one in loops_of(batch)) >= 3  # samples, steps, and sums over neighbours in a step
    assert max(one.counted for one in loops_of(batch)) > 100


def lowered(function: Any, *arguments: jax.Array) -> Any:
    return jax.jit(function).trace(*arguments).lower(lowering_platforms=("cuda",)).compiler_ir("stablehlo")


def test_a_loop_that_copies_is_found() -> None:
    """Whose condition differs between members: rounds of the slowest keep the others as they are."""

    def doubled(state: jax.Array, least: jax.Array) -> jax.Array:
        return jax.lax.while_loop(lambda one: one.sum() < least, lambda one: one * 2, state)

    found = Inspection.of(lowered(jax.vmap(doubled), jnp.ones((3, 50)), jnp.arange(3.0)), 150)
    assert [one.copied for one in loops_of(found)] == [[(3, 50)]]
    together = Inspection.of(lowered(jax.vmap(doubled, (0, None)), jnp.ones((3, 50)), jnp.asarray(3.0)), 151)
    assert [one.copied for one in loops_of(together)] == [[]]  # too small to count


def test_a_call_of_the_host_is_found() -> None:
    def asked(state: jax.Array) -> jax.Array:
        return jax.pure_callback(lambda one: one, jax.ShapeDtypeStruct(state.shape, state.dtype), state)

    # of another platform than this one, jax lowers no such call
    module = jax.jit(asked).trace(jnp.ones(5)).lower().compiler_ir("stablehlo")
    assert Inspection.of(module, 50).host_calls
