"""Streams of random numbers: none is another's, whatever the seeds."""

import numpy as np

from yeastfit.inference.simulator import member_seeds, stream_seeds
from yeastfit.seeds import Stream, stream_of


def test_no_stream_shares_a_simulation_with_another_or_with_a_neighbouring_seed() -> None:
    ensembles = [member_seeds(seed, 64) for seed in range(4)]
    ensembles += [stream_seeds(seed, stream, 64) for seed in range(4) for stream in Stream]
    every = np.concatenate(ensembles)
    assert len(np.unique(every)) == len(every)


def test_streams_begin_differently_and_repeat() -> None:
    first = [tuple(stream_of(seed, stream, 0).generate_state(4)) for seed in range(4) for stream in Stream]
    assert len(set(first)) == len(first)
    np.testing.assert_array_equal(stream_seeds(3, Stream.SURFACE, 5), stream_seeds(3, Stream.SURFACE, 8)[:5])
