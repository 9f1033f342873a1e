"""Chains of ABC-MCMC that stood still for long."""

import numpy as np
from jaxtyping import Bool

SHARE, STEPS = 0.25, 50  # of a run, and at least so many: a chain that does not move for longer is warned of
REMEDY = "a larger tolerance would let it move"


def standstills(moved: Bool[np.ndarray, "draw chain"]) -> list[str]:
    """Warnings of chains, by whether each moved in each step."""
    warnings, steps = [], len(moved)
    for chain, each in enumerate(moved.T):
        ends = np.flatnonzero(np.concatenate([[True], each, [True]]))
        longest = int(np.diff(ends).max()) - 1
        if longest == steps:
            warnings.append(f"chain {chain} accepted none of {steps} proposals: {REMEDY}, or smaller proposals")
        elif longest >= max(STEPS, SHARE * steps):
            warnings.append(f"chain {chain} stood still for {longest} of {steps} steps: {REMEDY}")
    return warnings
