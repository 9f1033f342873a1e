"""Sums of a number of terms that is data: values, and derivatives by jvp, vjp, vmap and inside of scans."""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, PyTree

from yeastfit.model.differentiable_sum import linear_map, sum_of_terms

N = 4
Args = dict[str, Array]


@pytest.fixture(scope="module", autouse=True)
def precise() -> Iterator[None]:
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="module")
def args() -> Args:
    rng = np.random.default_rng(0)
    return {
        "x": jnp.asarray(rng.normal(size=N)),
        "scale": jnp.asarray(0.7),
        "which": jnp.asarray(rng.permutation(N)),  # which are whole numbers, and which are truth values, stays data
        "counts": jnp.asarray([True, True, False, True]),
    }


def add(total: Array, i: Array, args: Args) -> Array:
    """Adds one term to a vector: sin(scale x_k) at k, and its square beside."""
    k = args["which"][i]
    term = jnp.where(args["counts"][k], jnp.sin(args["scale"] * args["x"][k]), 0.0)
    return total.at[k].add(term).at[(k + 1) % N].add(term**2)


def total(args: Args, trips: int | Array = N) -> Array:
    return sum_of_terms(add, jnp.asarray(trips), jnp.zeros(N), args)


def plain(args: Args, trips: int = N) -> Array:
    """The same, unrolled, as jax differentiates it by itself."""
    found = jnp.zeros(N)
    for i in range(trips):
        found = add(found, jnp.asarray(i), args)
    return found


def of_reals(function: Callable[..., Array], args: Args, **more: int) -> Callable[[Array, Array], Array]:
    return lambda x, scale: function({**args, "x": x, "scale": scale}, **more)


def same(one: PyTree, other: PyTree) -> None:
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-14), one, other)


def compiled(*ways: Callable[..., PyTree]) -> Callable[..., list[PyTree]]:
    """All of them in one program."""
    return jax.jit(lambda *at: [way(*at) for way in ways])


@pytest.mark.parametrize("trips", [1, N])
def test_value_and_derivatives_are_those_of_the_sum_written_out(args: Args, trips: int) -> None:
    ours, theirs = (
        compiled(f, jax.jacfwd(f, (0, 1)), jax.jacrev(f, (0, 1)), jax.jacrev(f, 0), jax.jacrev(f, 1))
        for f in (of_reals(total, args, trips=trips), of_reals(plain, args, trips=trips))
    )
    same(ours(args["x"], args["scale"]), theirs(args["x"], args["scale"]))


def test_without_a_program_around(args: Args) -> None:
    at = args["x"], args["scale"]
    same(of_reals(total, args)(*at), of_reals(plain, args)(*at))
    same(jax.jacrev(of_reals(total, args), 0)(*at), jax.jit(jax.jacfwd(of_reals(plain, args)))(*at))


def test_trips_are_data(args: Args) -> None:
    """One program for any number of terms, forwards and backwards."""
    traces = []

    @jax.jit
    def gradient(x: Array, trips: Array) -> Array:
        traces.append(trips)
        return jax.grad(lambda x: total({**args, "x": x}, trips)[2])(x)

    for trips in (0, 3, N):
        expected = jax.jit(jax.grad(lambda x, n=trips: plain({**args, "x": x}, n)[2]))
        same(gradient(args["x"], jnp.asarray(trips)), expected(args["x"]))
    assert len(traces) == 1


@pytest.mark.parametrize("in_axes", [(1, None), (0, 0)], ids=str)
def test_vmap_of_value_jvp_and_vjp(args: Args, in_axes: tuple[int | None, int | None]) -> None:
    """Over any of the arguments, along any axis, and over directions as well."""
    rng = np.random.default_rng(1)
    shapes = {None: (N,), 0: (3, N), 1: (N, 3)}
    x = jnp.asarray(rng.normal(size=shapes[in_axes[0]]))
    scale = jnp.asarray(rng.normal(size=() if in_axes[1] is None else (3,)))
    weights = jnp.asarray(rng.normal(size=N))

    def results(function: Callable[..., Array]) -> PyTree:
        f = of_reals(function, args)

        def one(x: Array, scale: Array) -> PyTree:
            forward = jax.jvp(f, (x, scale), (jnp.cos(x), jnp.ones(())))
            gradients = jax.vjp(f, x, scale)[1](weights)
            return forward, gradients, jax.jacfwd(f, (0, 1))(x, scale), jax.jacrev(f, (0, 1))(x, scale)

        return jax.jit(jax.vmap(one, in_axes))(x, scale)

    same(results(total), results(plain))


def test_vmap_over_the_number_of_terms(args: Args) -> None:
    trips, x = (0, 2, N), args["x"]

    @jax.jit
    def ours(x: Array, trips: Array) -> tuple[Array, Array]:
        gradient = lambda n: jax.grad(lambda x: total({**args, "x": x}, n).sum())(x)  # noqa: E731
        value = lambda n: total({**args, "x": jnp.cos(x)}, n)  # noqa: E731
        return jax.vmap(gradient)(trips), jax.vmap(value)(trips)

    @jax.jit
    def theirs(x: Array) -> tuple[Array, Array]:
        values = [plain({**args, "x": jnp.cos(x)}, n) for n in trips]
        return jax.grad(lambda x: plain({**args, "x": x}, 2).sum())(x), jnp.stack(values)

    (gradients, values), (gradient, expected) = ours(x, jnp.asarray(trips)), theirs(x)
    same(values, expected)
    same(gradients[1], gradient)
    same(gradients[0], np.zeros(N))


def test_forward_over_reverse_and_over_forward(args: Args) -> None:
    def second(function: Callable[..., Array]) -> list[PyTree]:
        f = lambda *r: jnp.sum(of_reals(function, args)(*r) ** 2)  # noqa: E731
        over = compiled(jax.jacfwd(jax.grad(f, (0, 1)), (0, 1)), jax.jacfwd(jax.jacfwd(f, (0, 1)), (0, 1)))
        return over(args["x"], args["scale"])

    ours = second(total)
    same(ours, second(plain))
    same(ours[0], ours[1])
    same(ours[0][0][1], ours[0][1][0])  # symmetric


@pytest.mark.thorough
def test_inside_what_a_trajectory_is_made_of(args: Args) -> None:
    """A scan of checkpointed steps, each of which may be left out, with a sum whose number of terms depends on x."""

    def grown(function: Callable[..., Array], x: Array, dynamic: bool) -> Array:
        def step(x: Array, k: Array) -> tuple[Array, None]:
            moved = lambda x: x + 0.1 * function({**args, "x": x}, jnp.sum(x > -9) if dynamic else N)  # noqa: E731
            return jax.lax.cond(k % 3 != 1, moved, lambda x: x, x), None

        def block(x: Array, k: Array) -> tuple[Array, None]:
            return jax.lax.scan(jax.checkpoint(step), x, 4 * k + jnp.arange(4))

        return jax.lax.scan(jax.checkpoint(block), x, jnp.arange(3))[0]

    ours, theirs = (
        compiled(f, jax.jacfwd(f), jax.jacrev(f), jax.hessian(lambda x, f=f: f(x)[0]))(args["x"])
        for f in (lambda x: grown(total, x, True), lambda x: grown(plain, x, False))
    )
    same(ours, theirs)


def test_terms_of_several_arrays_and_of_single_precision(args: Args) -> None:
    def pair(so_far: tuple[Array, Array], i: Array, args: tuple[Array, Array]) -> tuple[Array, Array]:
        x, y = args
        return so_far[0] + x[i] * y[i], so_far[1].at[i].add(jnp.exp(x[i]))

    @jax.jit
    def pulled(x: Array, y: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        f = lambda x, y: sum_of_terms(pair, jnp.asarray(N), (jnp.zeros(()), jnp.zeros(N)), (x, y))  # noqa: E731
        values, pull = jax.vjp(f, x, y)
        return values, pull((jnp.ones(()), jnp.ones(N)))

    with jax.enable_x64(False):
        x = np.linspace(-1, 1, N, dtype=np.float32)
        (dot, powers), slopes = pulled(x, x + 1)
        np.testing.assert_allclose(dot, np.sum(x * (x + 1)), rtol=1e-6)
        np.testing.assert_allclose(powers, np.exp(x), rtol=1e-6)
        for found, expected in zip(slopes, (x + 1 + np.exp(x), x), strict=True):
            assert found.dtype == jnp.float32
            np.testing.assert_allclose(found, expected, rtol=1e-6)


# --- linear_map ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def matrix() -> Array:
    return jnp.asarray(np.random.default_rng(2).normal(size=(3, N)))


def mapped(a: Array, x: Array) -> dict[str, Array]:
    """exp(A) x by a loop, of which jax finds no transpose."""

    def forward(a: Array, x: dict[str, Array]) -> dict[str, Array]:
        row = lambda i, y: y.at[i].set(jnp.exp(a[i]) @ x["x"])  # noqa: E731
        return {"y": jax.lax.fori_loop(0, jnp.asarray(a.shape[0]), row, jnp.zeros(a.shape[0]))}

    return linear_map(forward, lambda a, y: {"x": jnp.exp(a).T @ y["y"]}, a, {"x": x})


def test_linear_map_is_transposed_as_it_is_told(matrix: Array) -> None:
    x, y = (jnp.asarray(np.random.default_rng(k).normal(size=n)) for k, n in ((3, N), (4, 3)))
    f = lambda x: mapped(matrix, x)  # noqa: E731

    @jax.jit
    def found(x: Array, y: Array) -> list[PyTree]:
        value, pull = jax.vjp(f, x)
        # twice transposed it is itself again
        back = jax.linear_transpose(f, x)
        again = jax.linear_transpose(lambda y: back({"y": y})[0], y)
        slopes = [way(lambda x: f(x)["y"])(x) for way in (jax.jacrev, jax.jacfwd)]
        return [value, pull({"y": y})[0], *slopes, again(x)[0]]

    a = np.exp(matrix)
    same(found(x, y), [{"y": a @ np.asarray(x)}, a.T @ np.asarray(y), a, a, a @ np.asarray(x)])


def test_linear_map_has_a_derivative_in_what_it_is_made_of(matrix: Array) -> None:
    """Forwards in A and in x, apart and together; and forwards over backwards."""
    x = jnp.linspace(-1.0, 2.0, N)
    ours, theirs = (lambda a, x: mapped(a, x)["y"]), (lambda a, x: jnp.exp(a) @ x)
    ways: list[Any] = [lambda f, k=k: jax.jacfwd(f, k) for k in (0, 1, (0, 1))]
    ways.append(lambda f: jax.jacfwd(jax.grad(lambda a, x: jnp.sum(f(a, x)), 1), (0, 1)))
    same(compiled(*(way(ours) for way in ways))(matrix, x), compiled(*(way(theirs) for way in ways))(matrix, x))


@pytest.mark.parametrize("in_axes", [(0, None), (None, 0), (2, 1)], ids=str)
def test_linear_map_under_vmap(in_axes: tuple[int | None, int | None]) -> None:
    rng = np.random.default_rng(5)
    a, x = jnp.asarray(rng.normal(size=(3, N))), jnp.asarray(rng.normal(size=N))
    a = a if in_axes[0] is None else jnp.stack([a, 0.5 * a], axis=in_axes[0])
    x = x if in_axes[1] is None else jnp.stack([x, x**2], axis=in_axes[1])
    ours, theirs = (lambda a, x: mapped(a, x)["y"]), (lambda a, x: jnp.exp(a) @ x)
    ways: list[Any] = [lambda f: f, lambda f: jax.jacrev(f, 1), lambda f: jax.jacfwd(f, 1), jax.jacfwd]
    found, expected = (compiled(*(jax.vmap(way(f), in_axes) for way in ways)) for f in (ours, theirs))
    same(found(a, x), expected(a, x))
    np.testing.assert_allclose(jax.vmap(ours, in_axes)(a, x), jax.vmap(theirs, in_axes)(a, x))
