"""Seeds of random numbers: whole numbers from 0 to 2⁶⁴ − 1, each with a stream of its own."""

from enum import IntEnum
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Shaped, UInt32

from yeastfit.errors import InputError
from yeastfit.numbers import SEEDS
from yeastfit.text import quoted

LOW_HALF = 0xFFFFFFFF


class Stream(IntEnum):
    """What a run draws random numbers for, besides its simulations."""

    TRUTH = 0
    PRIOR = 1
    PROPOSALS = 2
    DRAWS = 3
    PREDICTIVE = 4
    ERRORS = 5
    STARTS = 6
    RESAMPLING = 7
    SCREENING = 8
    SURFACE = 9
    COLONIES = 10
    SEARCH = 11
    TRAINING = 12
    CHAINS = 13
    BOOTSTRAP = 14
    DIRECTIONS = 15
    WEIGHTS = 16
    CONDITIONS = 17
    AREAS = 18


def check_seed(seed: Any) -> int:
    """Check a seed.

    Arguments:
        seed: Anything.

    Returns:
        The seed.

    Raises:
        InputError: It is no whole number from 0 to 2⁶⁴ − 1.
    """
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or not SEEDS.low <= int(seed) <= SEEDS.high:
        raise InputError(f"seed is {quoted(seed)}, it must be {SEEDS.whole}")
    return int(seed)


def check_seeds(seeds: Any) -> list[int]:
    """Check a list of seeds, one a colony.

    Arguments:
        seeds: Anything.

    Returns:
        The seeds.

    Raises:
        InputError: They are no list, or one of them is no seed.
    """
    if isinstance(seeds, str) or np.ndim(seeds) != 1:
        raise InputError(f"seeds is {quoted(seeds)}, it must be a list of them, such as [0, 1, 2]")
    return [check_seed(one) for one in seeds]


def stream_of(seed: int, stream: Stream, *key: int) -> np.random.SeedSequence:
    """Where the random numbers of a named stream come from; further numbers say which of it, such as a step."""
    if not key:
        raise InputError(f"key is empty, a stream needs at least one number: {stream!r} alone is a simulation's")
    check_seed(seed)
    return np.random.SeedSequence(seed, spawn_key=(int(stream), *key))


def key_of(seed: int | Array) -> Array:
    """jax's random key of a seed; a key is returned as it is.

    Of seeds below 2³² it is that of `jax.random.key`, which in single precision leaves out the upper half of others.
    """
    if isinstance(seed, jax.Array):
        return seed
    return jax.random.wrap_key_data(jax.device_put(_halves([check_seed(seed)])[0]))


def keys_of(seeds: Shaped[np.ndarray, " row"] | list[int]) -> Array:
    """jax's random keys, whose bits are the seeds'."""
    return jax.random.wrap_key_data(jax.device_put(_halves(seeds)))


def _halves(seeds: Shaped[np.ndarray, " row"] | list[int]) -> UInt32[np.ndarray, "row 2"]:
    """The upper and the lower 32 bits."""
    words = np.asarray(seeds, dtype=np.uint64)
    return np.stack([words >> np.uint64(32), words & np.uint64(LOW_HALF)], axis=1).astype(np.uint32)


def photograph_stream(seed: int, member: int, time: int) -> np.random.Generator:
    """Random numbers of the photograph of a colony at a time, both counted from 0."""
    if seed <= LOW_HALF:
        return np.random.default_rng([seed, member, time])
    return np.random.default_rng(np.random.SeedSequence(check_seed(seed), spawn_key=(member, time)))
