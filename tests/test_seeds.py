"""Every seed from 0 to 2⁶⁴ − 1 has random numbers of its own, in each stream that a command draws from."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
import pytest

from yeastfit.commands import app as cli
from yeastfit.commands.synthesize import read_recipes
from yeastfit.errors import InputError
from yeastfit.inference.polynomial import sobol_points
from yeastfit.inference.simulator import member_seeds, seed_of
from yeastfit.offlattice.random_numbers import seeded
from yeastfit.seeds import Stream, check_seed, key_of, keys_of, photograph_stream, stream_of
from yeastfit.simulation.simulate import member_keys

HIGH = 2**64 - 1
SEEDS = (0, 1, 2**31, 2**32 - 1, 2**32, 2**32 + 1, 3 << 32, 2**63, HIGH - 1, HIGH)
STREAMS: dict[str, Callable[[int], Any]] = {
    "colonies of simulate and synthesize": lambda seed: jax.random.key_data(member_keys(seed, 2)),
    "colonies of fit, sensitivity and design": lambda seed: member_seeds(seed, 2),
    "colonies of gradcheck": lambda seed: jax.random.key_data(key_of(seed)),
    "simulations of infer": lambda seed: seed_of(seed, range(4)),
    "proposals and draws of infer": lambda seed: stream_of(seed, Stream.PROPOSALS, 1).generate_state(4),
    "screening of fit": lambda seed: sobol_points(4, 2, stream_of(seed, Stream.SCREENING, 0)),
    "photographs": lambda seed: photograph_stream(seed, 1, 0).random(2),
    "off-lattice colonies": lambda seed: seeded(seed).state,
}


@pytest.mark.parametrize("stream", STREAMS)
def test_no_two_seeds_share_a_stream(stream: str) -> None:
    drawn = {np.asarray(STREAMS[stream](seed)).tobytes() for seed in SEEDS}
    assert len(drawn) == len(SEEDS)


def test_small_seeds_give_what_jax_and_numpy_give() -> None:
    for seed in (0, 1, 7, 2**31, 2**32 - 1):
        assert (jax.random.key_data(key_of(seed)) == jax.random.key_data(jax.random.key(seed))).all()
        ours, numpys = photograph_stream(seed, 3, 2), np.random.default_rng([seed, 3, 2])
        assert (ours.random(3) == numpys.random(3)).all()
    key = jax.random.key(5)
    assert key_of(key) is key


def test_keys_have_the_bits_of_seeds() -> None:
    data = jax.random.key_data(keys_of([2**32 + 5, HIGH]))
    assert data.tolist() == [[1, 5], [2**32 - 1, 2**32 - 1]]


def test_photographs_of_large_seeds_are_those_of_no_small_one() -> None:
    """`[seed, member, time]` alone would be the same words for some of them."""
    drawn = {
        photograph_stream(seed, member, time).random(2).tobytes()
        for seed in (0, 1, 2, 1 << 32, 2 << 32, (1 << 32) + 2)
        for member in range(3)
        for time in range(3)
    }
    assert len(drawn) == 6 * 9


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, 2.0, "3", True, None, float("nan"), 10**400])
def test_others_are_refused(seed: Any) -> None:
    with pytest.raises(InputError, match=r"seed is .* from 0 to 18446744073709551615"):
        check_seed(seed)


@pytest.mark.parametrize("seed", [-1, 2**64])
@pytest.mark.parametrize("stream", [each for each in STREAMS if not each.startswith("photographs")])
def test_every_stream_refuses_others(stream: str, seed: int) -> None:
    with pytest.raises(InputError, match=f"seed is {seed}, it must be a whole number"):
        STREAMS[stream](seed)


@pytest.mark.parametrize("seed", ["-1", "18446744073709551616", "1_0", "1e3", "٣", "0x1", ""])
@pytest.mark.parametrize("command", ["simulate", "synthesize", "fit", "infer", "gradcheck", "design"])
def test_every_command_refuses_others(command: str, seed: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run([command, "--seed", seed]) == 2
    assert f"--seed is '{seed}', it must be a whole number from 0 to 18446744073709551615" in capsys.readouterr().err


@pytest.mark.parametrize("seed", ["-1", "1.5", '"1"', "18446744073709551616", "true"])
def test_recipes_refuse_others(seed: str, tmp_path: Any, unchecked: None) -> None:
    (tmp_path / "recipes.toml").write_text(f"[one]\nseed = {seed}\nhours = [4]\nparameters = {{}}\n")
    with pytest.raises(InputError, match=r"\[one\]: seed is"):
        read_recipes(tmp_path / "recipes.toml")
