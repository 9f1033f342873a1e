"""Options of benchmarks that simulate on worker processes: --workers N and --scheduler tcp://HOST:PORT."""

import argparse
import sys

from yeastfit.inference.workers.spread import Workers


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add both options, of which one may be given."""
    either = parser.add_mutually_exclusive_group()
    either.add_argument("--workers", type=int)
    either.add_argument("--scheduler")


def workers_of(given: argparse.Namespace) -> Workers | None:
    """What was asked for; None for nothing. Raises `InputError` for a number below 1."""
    if given.workers is None and given.scheduler is None:
        return None
    return Workers(given.workers, given.scheduler, say=lambda line: print(line, file=sys.stderr, flush=True))
