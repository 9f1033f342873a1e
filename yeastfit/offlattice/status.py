"""How the growth of a colony ended, in words."""

from enum import Enum


class Status(Enum):
    """How growth ended; the value is what a reader is told."""

    GROWN = "all cells were born"
    OUTSIDE = "not simulated: a parameter lies outside [0, 1]"
    SINGLE = "not simulated: with cells = 1 the colony is its first cell"
    TOO_LARGE = "not simulated: so many cells do not fit into memory"
    NO_MOTHER = "no cell could bud any more"
    NO_SATED_MOTHER = "no sated cell could bud any more"
    NO_PSEUDOHYPHAL_MOTHER = "no pseudohyphal cell could bud any more"
    NO_CHILDLESS_MOTHER = "no cell without pseudohyphal daughters could bud any more"
    ENDLESS = "no free place for a daughter was found in as many attempts as are allowed for one birth"
    STREAM_ENDED = "the given stream of uniform numbers came to its end"


CODES = {status: code for code, status in enumerate(Status)}
"""Whole numbers for kernels."""
