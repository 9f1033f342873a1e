"""Uniform random numbers on [0, 1): xoshiro256++, or a given stream of them.

With the four words s0 … s3 of the state, 64 bits each, and rotl(x, k) a rotation to the left by k bits, every number is

    r = rotl(s0 + s3, 23) + s0,    u = ⌊r / 2¹¹⌋ / 2⁵³,

and the state moves on by t = s1 ≪ 17, s2 ^= s0, s3 ^= s1, s1 ^= s2, s0 ^= s3, s2 ^= t, s3 = rotl(s3, 45): Blackman &
Vigna 2021, "Scrambled linear pseudorandom number generators", ACM Trans. Math. Softw. 47:36, doi:10.1145/3460772. Every
colony has a generator of its own, whose state comes from its seed alone: the same seed gives the same colony on any
number of threads and in any batch.

Numbers are made many at a time, as an attempt looks ahead and goes back (`growth`), and waits less for the generator.

A given stream makes colonies comparable with other programs': MATLAB's `rand` after `rng(s)` gives the numbers of
`numpy.random.RandomState(s).random_sample()`.
"""

from numbers import Integral
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt64

from yeastfit.compiled import Index, kernel
from yeastfit.errors import InputError
from yeastfit.text import quoted

MOST_SEED = 2**64
KEPT = 128  # a power of two
Words = tuple[np.uint64, np.uint64, np.uint64, np.uint64]


class Numbers(NamedTuple):
    """Where uniform numbers come from.

    Attributes:
        state: The generator's four words; it runs ahead of what was drawn.
        stream: The numbers themselves, in place of the generator; empty where there is none.
        ahead: Numbers made, `KEPT` of them in a ring: those that come next, and those drawn last.
        made: How many were made, one element.
        drawn: How many were drawn, one element. Beyond the end of a stream they are 0, and are counted all the same.
    """

    state: UInt64[np.ndarray, " 4"]
    stream: Float[np.ndarray, " number"]
    ahead: Float[np.ndarray, " kept"]
    made: Int[np.ndarray, " 1"]
    drawn: Int[np.ndarray, " 1"]


def seeded(seed: int) -> Numbers:
    """A generator, its state from `numpy.random.SeedSequence(seed)`.

    Raises:
        InputError: The seed is not a whole number of 64 bits.
    """
    if not (isinstance(seed, Integral) and 0 <= seed < MOST_SEED):
        raise InputError(f"seed is {quoted(seed)}, it must be a whole number of at least 0 and below 2^64")
    state = np.random.SeedSequence(int(seed)).generate_state(4, np.uint64)
    return _numbers(state, np.empty(0))


def streamed(stream: Float[np.ndarray, " number"]) -> Numbers:
    """The given numbers, in their order.

    Raises:
        InputError: There are none, or they are no numbers of at least 0 and below 1, one after the other.
    """
    given = np.ascontiguousarray(stream, dtype=float)
    if not given.size:
        raise InputError("stream is empty, a colony needs some uniform numbers for every cell")
    wrong = ~((given >= 0) & (given < 1))
    if given.ndim != 1 or wrong.any():
        found = f"has the shape {given.shape}" if given.ndim != 1 else f"holds {given[wrong][0]:g}"
        raise InputError(f"stream {found}, it must be a sequence of numbers of at least 0 and below 1")
    return _numbers(np.zeros(4, dtype=np.uint64), given)


def _numbers(state: UInt64[np.ndarray, " 4"], stream: Float[np.ndarray, " number"]) -> Numbers:
    return Numbers(state, stream, np.zeros(KEPT), np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64))


@kernel
def uniform(numbers: Numbers) -> float:
    """The next number."""
    position = numbers.drawn[0]
    numbers.drawn[0] = position + 1
    return _number_at(numbers, position)


@kernel
def below(numbers: Numbers, count: int) -> int:
    """A whole number from 0 to count − 1, every one as likely: ⌊count · u⌋ of one uniform number u."""
    return int(count * uniform(numbers))


@kernel
def foreseen(numbers: Numbers, skipped: int) -> tuple[float, float]:
    """Two numbers that come after so many others, without drawing them."""
    position = numbers.drawn[0] + skipped
    return _number_at(numbers, position), _number_at(numbers, position + 1)


@kernel
def place(numbers: Numbers) -> int:
    """How far drawing has come."""
    return numbers.drawn[0]


@kernel
def return_to(place: int, numbers: Numbers) -> None:
    """What was drawn since then will be drawn again: half of `KEPT` at most, with what was foreseen."""
    numbers.drawn[0] = place


@kernel
def _number_at(numbers: Numbers, position: int) -> float:
    if position >= numbers.made[0]:
        _make(numbers)
    return numbers.ahead[Index(position & (KEPT - 1))]


@kernel
def _make(numbers: Numbers) -> None:
    """The next half of a ring of numbers, in place of those drawn longest ago."""
    state, made = numbers.state, numbers.made[0]
    words = state[0], state[1], state[2], state[3]
    for position in range(made, made + KEPT // 2):
        number = 0.0
        if numbers.stream.size == 0:
            number, words = _number(words), _moved_on(words)
        elif position < numbers.stream.size:
            number = numbers.stream[position]
        numbers.ahead[Index(position & (KEPT - 1))] = number
    state[0], state[1], state[2], state[3] = words
    numbers.made[0] = made + KEPT // 2


@kernel
def _number(words: Words) -> float:
    return np.float64((_rotated(words[0] + words[3], np.uint64(23)) + words[0]) >> np.uint64(11)) * 2.0**-53


@kernel
def _moved_on(words: Words) -> Words:
    s0, s1, s2, s3 = words
    shifted = s1 << np.uint64(17)
    s2 ^= s0
    s3 ^= s1
    return s0 ^ s3, s1 ^ s2, s2 ^ shifted, _rotated(s3, np.uint64(45))


@kernel
def _rotated(word: np.uint64, bits: np.uint64) -> np.uint64:
    return (word << bits) | (word >> (np.uint64(64) - bits))
