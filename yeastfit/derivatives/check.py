"""Are derivatives right? Forward mode against differences and against reverse mode, on any function.

Forward mode gives J d, the derivative of f at x along a direction d. Differences give

    D_h = (f(x + h d) − f(x − h d)) / 2h    and    E_h = |f(x + h d) − 2 f(x) + f(x − h d)| / 2h,

half the difference of the two one-sided slopes: what rounding, a kink or a jump between the three points can do to D_h,
and more than curvature does. No one h suits all, and a simulated colony has a kink every 10⁻⁵ or so, where nodes pass
lines of the grid. So D_h is as uncertain as the larger of E_h and the change to the next h, and the least uncertain one
is taken. Steps between whose two sides the order of parents changes are left out: it is discrete
(docs/model.md, section 5).

Reverse mode gives Jᵀ v, and ⟨v, J d⟩ = ⟨Jᵀ v, d⟩ for every d, here for one random v, to rounding.

J d itself is uncertain where an input changed by its last bit changes it: colonies are chaotic. Where uncertainties are
large, neither agreement nor disagreement means anything, and the verdict is "uncertain".
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, PyTree

from yeastfit.derivatives.result import AGREES, DerivativeComparison, GradientCheck
from yeastfit.errors import InputError
from yeastfit.numbers import POSITIVE, array_of
from yeastfit.progress import Progress, silent
from yeastfit.seeds import Stream, stream_of
from yeastfit.text import quoted

STEPS = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
TRANSPOSE = 1e-9  # what rounding may leave between forward and reverse mode
NUDGE = 1e-15  # a change of the inputs as large as their rounding
ROUNDINGS = 1e3  # what a program rounds on the way, in units of what that changes
FLOOR = 1e-3  # derivatives below this share of the value itself are compared to that share
Pair = Callable[[PyTree], tuple[PyTree, PyTree]]  # of inputs: outputs and discrete decisions


def check_derivatives(
    function: Callable[[PyTree], PyTree],
    inputs: PyTree,
    directions: Mapping[str, PyTree] | None = None,
    *,
    tolerance: float = 1e-6,
    steps: Sequence[float] = STEPS,
    seed: int = 0,
    has_aux: bool = False,
) -> GradientCheck:
    """Check JAX's derivatives of any function of floating-point arrays, both ways, in double precision.

    Where value and derivative are both 0 there is nothing to be relative to, and the verdict is likely "uncertain".

    Arguments:
        function: Of one pytree, to a pytree of arrays; with `has_aux`, to a pair of that and of its discrete decisions,
            arrays that must be equal on both sides of a difference.
        inputs: Where to differentiate.
        directions: By name, pytrees like `inputs`; by default a random one for each of its arrays, as large as the
            array's largest entry.
        tolerance: Relative, of differences. Reverse and forward mode must agree to 1e-9.
        steps: h, in units of a direction.
        seed: Of random directions and of v.
        has_aux: Whether `function` returns its discrete decisions too.

    Returns:
        A `GradientCheck` with every comparison.

    Raises:
        InputError: Inputs or directions are not floating-point arrays of the same shapes.
    """
    POSITIVE.check(tolerance, "tolerance")
    numbers = array_of(steps, "steps")
    if numbers.ndim != 1 or not numbers.size or not (numbers > 0).all():
        raise InputError(f"steps is {quoted(steps)}, it must be numbers above 0, such as (1e-3, 1e-4)")
    with jax.enable_x64(True):
        x = double(inputs, "inputs")
        along = _random(x, seed) if directions is None else _like(x, directions)
        for name, d in (directions or {}).items():
            if not any(np.any(leaf) for leaf in jax.tree.leaves(d)):
                raise InputError(f"directions: {name!r} is 0 everywhere, there is nothing to compare along it")
        if not along:
            raise InputError("inputs hold no array, there is nothing to differentiate by")
        pair = function if has_aux else lambda x: (function(x), ())
        with np.errstate(all="ignore"):  # what is not finite gets a verdict
            return GradientCheck(compare(pair, x, along, tolerance, steps, seed)[0], tolerance)


def compare(
    pair: Pair,
    x: PyTree,
    along: Mapping[str, PyTree],
    tolerance: float,
    steps: Sequence[float],
    seed: int,
    progress: Progress = silent,
    of: Callable[[PyTree], PyTree] = lambda outputs: outputs,
) -> tuple[tuple[DerivativeComparison, ...], dict[str, PyTree]]:
    """Comparisons of `of(outputs)`, where `pair` gives outputs and decisions; and J d of all outputs, by direction."""

    def flat(x: PyTree) -> tuple[Array, PyTree]:
        outputs, decisions = pair(x)
        return ravel_pytree(of(outputs))[0].astype(jnp.float64), decisions

    labels = _labels(of(pair(x)[0]))
    if not labels:
        raise InputError("function gives no output, there is nothing to compare")
    value, decisions = jax.tree.map(np.asarray, flat(x))
    nudged = x
    for d in along.values():
        nudged = _moved(nudged, d, NUDGE)
    found, tangents, forward, noise, chosen = [], {}, {}, {}, {}
    for k, (name, d) in enumerate(along.items()):
        progress(f"derivatives along {name}", k / len(along))
        _, tangents[name], chosen[name] = jax.jvp(pair, (x,), (d,), has_aux=True)
        _, beside, alike = jax.jvp(flat, (nudged,), (d,), has_aux=True)
        forward[name] = np.asarray(ravel_pytree(of(tangents[name]))[0], np.float64)
        noise[name] = ROUNDINGS * (np.asarray(beside) - forward[name]) if _same(alike, decisions) else 0.0 * value
        # jax's programs of values and of derivatives round differently, which may decide between equals
        usable = steps if _same(chosen[name], decisions) else ()
        other, uncertainty, crossed = _differences(flat, x, d, value, decisions, usable)
        scale = np.fmax(np.fmax(np.abs(forward[name]), np.abs(other)), FLOOR * np.abs(value))
        numbers = np.stack([forward[name], other, uncertainty + np.abs(noise[name]), scale], axis=-1)
        for (output, index), (f, o, u, s) in zip(labels, numbers.tolist(), strict=True):
            verdict = _verdict(f, o, u, tolerance * s, crossed)
            found.append(DerivativeComparison("differences", name, output, index, f, o, u, s, verdict))
    progress("reverse mode", 1.0)
    # every output counts alike
    largest = np.max([np.abs(tangent) for tangent in forward.values()], axis=0, initial=0.0)
    rng = np.random.default_rng(stream_of(seed, Stream.WEIGHTS, 0))
    v = rng.normal(size=value.shape) / np.where(largest > 0, largest, 1.0)
    _, pull, decided = jax.vjp(flat, x, has_aux=True)
    gradient = np.asarray(ravel_pytree(pull(jnp.asarray(v))[0])[0])
    for name, d in along.items():
        terms, back = v * forward[name], gradient * np.asarray(ravel_pytree(d)[0])
        f, o, s = float(terms.sum()), float(back.sum()), float(np.abs(terms).sum())
        u = abs(float((v * noise[name]).sum())) if f != o else 0.0
        verdict = _verdict(f, o, u, TRANSPOSE * s, crossed=not _same(decided, chosen[name]))
        found.append(DerivativeComparison("transpose", name, "all", (), f, o, u, s, verdict))
    return tuple(found), tangents


def _differences(
    flat: Callable[[PyTree], tuple[Array, PyTree]],
    x: PyTree,
    d: PyTree,
    value: np.ndarray,
    decisions: PyTree,
    steps: Sequence[float],
) -> tuple[np.ndarray, np.ndarray, bool]:
    """D_h and its uncertainty for the best h of each output; and whether every h crosses."""
    slopes, errors = [], []
    for h in steps:
        (up, above), (down, below) = flat(_moved(x, d, h)), flat(_moved(x, d, -h))
        if _same(above, decisions) and _same(below, decisions):
            rounding = 2 * np.finfo(float).eps * np.abs(value) / h
            slopes.append(np.asarray(up - down) / (2 * h))
            errors.append(np.abs(np.asarray(up + down) - 2 * value) / (2 * h) + rounding)
    if not slopes:
        return np.full(value.shape, np.nan), np.full(value.shape, np.inf), True
    change = np.abs(np.diff(slopes, axis=0, append=slopes[-2:-1] or slopes))
    uncertainty = np.nan_to_num(np.fmax(errors, change), nan=np.inf)
    best = np.argmin(uncertainty, axis=0)[None]
    return np.take_along_axis(np.array(slopes), best, 0)[0], np.take_along_axis(uncertainty, best, 0)[0], False


def _moved(x: PyTree, d: PyTree, h: float) -> PyTree:
    return jax.tree.map(lambda a, b: a + h * b, x, d)


def _verdict(forward: float, other: float, uncertainty: float, slack: float, crossed: bool) -> str:
    """E_h may be ten times the tolerance, since curvature, the most of it, leaves D_h alone."""
    gap = abs(forward - other)
    if crossed and np.isfinite(forward):
        return "crossed"
    if not np.isfinite(gap):
        return "not finite"
    if gap <= slack and uncertainty <= 10 * slack:
        return AGREES
    return "differs" if gap > slack + 2 * uncertainty and uncertainty < 0.1 * abs(other) + slack else "uncertain"


def _same(one: PyTree, other: PyTree) -> bool:
    return all(map(np.array_equal, jax.tree.leaves(one), jax.tree.leaves(other)))


def _labels(outputs: PyTree) -> list[tuple[str, tuple[int, ...]]]:
    """Name and index of every number, in the order of `ravel_pytree`."""
    return [
        (jax.tree_util.keystr(path, simple=True, separator=".") or "output", index)
        for path, leaf in jax.tree_util.tree_leaves_with_path(outputs)
        for index in np.ndindex(np.shape(leaf))
    ]


def double(tree: PyTree, name: str) -> PyTree:
    """The same in double precision; raises `InputError` where an array is not of floating point."""
    for leaf in jax.tree.leaves(tree):
        if not jnp.issubdtype(jnp.result_type(leaf), jnp.floating):
            raise InputError(f"{name} hold {leaf!r}, they must be floating-point arrays")
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), tree)


def _like(x: PyTree, directions: Mapping[str, PyTree]) -> dict[str, PyTree]:
    """The directions in double precision, which must look like x."""
    shapes = jax.tree.map(jnp.shape, x)
    for name, direction in directions.items():
        if jax.tree.map(jnp.shape, direction) != shapes:
            raise InputError(f"direction {name!r} has shapes {jax.tree.map(jnp.shape, direction)}, inputs {shapes}")
    return {name: double(direction, f"direction {name!r}") for name, direction in directions.items()}


def _random(x: PyTree, seed: int) -> dict[str, PyTree]:
    """One random direction for each array of x, as large as its largest entry, or as 1 if that is 0."""
    rng, found = np.random.default_rng(stream_of(seed, Stream.DIRECTIONS, 0)), {}
    leaves, tree = jax.tree.flatten(x)
    for k, (path, leaf) in enumerate(jax.tree_util.tree_leaves_with_path(x)):
        d = rng.normal(size=leaf.shape)
        zeros: list[Any] = [jnp.zeros_like(leaf) for leaf in leaves]
        zeros[k] = jnp.asarray(d / np.max(np.abs(d), initial=1e-300) * (float(jnp.max(jnp.abs(leaf))) or 1.0))
        found[jax.tree_util.keystr(path, simple=True, separator=".") or "input"] = jax.tree.unflatten(tree, zeros)
    return found
