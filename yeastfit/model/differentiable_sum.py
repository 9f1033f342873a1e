"""Sums whose number of terms is data, differentiable forwards and backwards.

A neighbour search ends when there are no more neighbours. JAX differentiates such a loop forwards only: backwards it
would have to keep what it cannot count. Of a sum nothing needs keeping, its derivative is the sum of its terms'
derivatives either way, and `linear_map` tells JAX so. Under `vmap`, what does not depend on the mapped direction is
computed once for all directions.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Int, PyTree


def sum_of_terms(
    add: Callable[[PyTree, Int[Array, ""], PyTree], PyTree], trips: Int[Array, ""], zero: PyTree, args: PyTree
) -> PyTree:
    """`zero`, after total = add(total, i, args) for all i < trips; `add` adds a term to the total and does no more.

    Differentiable in the floating-point leaves of `args`, by jvp, by vjp, and by jvp of either. `add` closes over
    static values only.
    """
    leaves, tree = jax.tree.flatten(args)
    which = [jnp.issubdtype(leaf.dtype, jnp.inexact) for leaf in leaves]
    reals = [leaf for leaf, real in zip(leaves, which, strict=True) if real]
    others = [leaf for leaf, real in zip(leaves, which, strict=True) if not real]

    def together(others: Sequence[Array], reals: Sequence[Array]) -> PyTree:
        some, rest = iter(reals), iter(others)
        return jax.tree.unflatten(tree, [next(some if real else rest) for real in which])

    @jax.custom_jvp
    def total(trips: Array, zero: PyTree, others: list[Array], reals: list[Array]) -> PyTree:
        args = together(others, reals)
        return jax.lax.fori_loop(0, trips, lambda i, so_far: add(so_far, i, args), zero)

    @total.defjvp
    def total_jvp(primals: tuple, tangents: tuple) -> tuple[PyTree, PyTree]:
        return total(*primals), linear_map(forward, backward, primals, tangents[-1])

    def forward(known: tuple, tangents: list[Array]) -> PyTree:
        trips, zero, others, reals = known

        def step(i: Array, so_far: PyTree) -> PyTree:
            return jax.jvp(lambda t, *r: add(t, i, together(others, r)), (zero, *reals), (so_far, *tangents))[1]

        return jax.lax.fori_loop(0, trips, step, jax.tree.map(jnp.zeros_like, zero))

    def backward(known: tuple, cotangent: PyTree) -> list[Array]:
        trips, zero, others, reals = known

        def step(i: Array, so_far: list[Array]) -> list[Array]:
            pull = jax.vjp(lambda *r: add(zero, i, together(others, r)), *reals)[1]
            return [a + b for a, b in zip(so_far, pull(cotangent), strict=True)]

        return jax.lax.fori_loop(0, trips, step, [jnp.zeros_like(leaf) for leaf in reals])

    return total(trips, zero, others, reals)


def linear_map(
    forward: Callable[[PyTree, PyTree], PyTree], transpose: Callable[[PyTree, PyTree], PyTree], known: PyTree, x: PyTree
) -> PyTree:
    """forward(known, x), which is linear in x; transpose(known, y) is its transpose, and JAX need not find it.

    Neither closes over traced values. Where the derivative in `known` is asked for, `forward` itself is differentiated.
    """
    parts, known_tree = jax.tree.flatten(known)
    leaves, tree = jax.tree.flatten(x)
    out_tree = jax.tree.structure(jax.eval_shape(forward, known, x))

    def flat(law: Callable[[PyTree, PyTree], PyTree], of: Any) -> Callable[..., list[Array]]:
        def flattened(*args: Array) -> list[Array]:
            first, second = args[: len(parts)], args[len(parts) :]
            return jax.tree.leaves(law(jax.tree.unflatten(known_tree, first), jax.tree.unflatten(of, second)))

        return flattened

    out = _linear_map.bind(
        *parts, *leaves, forward=flat(forward, tree), transpose=flat(transpose, out_tree), known=len(parts)
    )
    return jax.tree.unflatten(out_tree, out)


_linear_map = Primitive("linear_map")
_linear_map.multiple_results = True


@_linear_map.def_impl
def _evaluate(*args: Array, forward: Callable, transpose: Callable, known: int) -> list[Array]:
    return forward(*args)


@_linear_map.def_abstract_eval
def _shapes(*args: Any, forward: Callable, transpose: Callable, known: int) -> list[Any]:
    return [jax.core.ShapedArray(out.shape, out.dtype) for out in jax.eval_shape(forward, *args)]


def _jvp(primals: tuple, tangents: tuple, *, forward: Callable, transpose: Callable, known: int) -> tuple[list, list]:
    rules = {"forward": forward, "transpose": transpose, "known": known}
    out = _linear_map.bind(*primals, **rules)
    if all(isinstance(t, ad.Zero) for t in tangents[:known]):
        return out, _linear_map.bind(*primals[:known], *map(ad.instantiate_zeros, tangents[known:]), **rules)
    return out, jax.jvp(forward, primals, tuple(map(ad.instantiate_zeros, tangents)))[1]


def _transposed(cotangents: list, *args: Any, forward: Callable, transpose: Callable, known: int) -> list:
    back = _linear_map.bind(
        *args[:known], *map(ad.instantiate_zeros, cotangents), forward=transpose, transpose=forward, known=known
    )
    unknown = [ad.is_undefined_primal(arg) for arg in args[known:]]
    return [None] * known + [ct if asked else None for ct, asked in zip(back, unknown, strict=True)]


def _batched(args: tuple, dims: tuple, *, forward: Callable, transpose: Callable, known: int) -> tuple[list, list[int]]:
    size = next(arg.shape[dim] for arg, dim in zip(args, dims, strict=True) if dim is not None)
    mapped = [
        jnp.broadcast_to(arg, (size, *arg.shape)) if dim is None else jnp.moveaxis(arg, dim, 0)
        for arg, dim in zip(args[known:], dims[known:], strict=True)
    ]
    axes = dims[:known]

    def over_all(law: Callable[..., list[Array]]) -> Callable[..., list[Array]]:
        return lambda *args: jax.vmap(law, in_axes=(*axes, *(0 for _ in args[known:])), axis_size=size)(*args)

    out = _linear_map.bind(
        *args[:known], *mapped, forward=over_all(forward), transpose=over_all(transpose), known=known
    )
    return out, [0] * len(out)


ad.primitive_jvps[_linear_map] = _jvp
ad.primitive_transposes[_linear_map] = _transposed
batching.primitive_batchers[_linear_map] = _batched
mlir.register_lowering(_linear_map, mlir.lower_fun(_evaluate, multiple_results=True))
