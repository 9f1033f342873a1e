"""What XLA calls: for each operation a function of a frame, which finds arguments and results in it (`foreign_call`).

Each is made for one precision. Numba keeps what it has compiled of a function on disk only where its closure holds
nothing but plain types, so that everything else is imported above. Importing this module imports numba.
"""

from typing import Any

import numpy as np

from yeastfit.model.compiled.covering import cover_all
from yeastfit.model.compiled.eating import eat
from yeastfit.model.compiled.foreign_call import NULL, Call, argument, is_question, result
from yeastfit.model.compiled.pulls import pull_together
from yeastfit.model.compiled.pushes import push_apart
from yeastfit.model.compiled.reading import read_gradient, read_nutrient


def contact(dtype: Any) -> Call:
    """Of `compiled_contact`."""

    def call(frame: Any) -> int:
        if is_question(frame):
            return NULL
        room, count = argument(frame, 2, 2, np.int32)
        reach, ramp, side = argument(frame, 3, 3, dtype)
        positions, weights = argument(frame, 0, (room, 2), dtype), argument(frame, 1, room, dtype)
        push_apart(positions, weights, count, reach, ramp, side, result(frame, 0, (room, 2), dtype))
        return NULL

    return call


def springs(dtype: Any) -> Call:
    """Of `compiled_springs`."""

    def call(frame: Any) -> int:
        if is_question(frame):
            return NULL
        room, count = argument(frame, 3, 2, np.int32)
        positions, parents = argument(frame, 0, (room, 2), dtype), argument(frame, 1, room, np.int32)
        pull_together(positions, parents, argument(frame, 2, room, dtype), count, result(frame, 0, (room, 2), dtype))
        return NULL

    return call


def eating(dtype: Any) -> Call:
    """Of `compiled_step`."""

    def call(frame: Any) -> int:
        if is_question(frame):
            return NULL
        origin, spacing, union, reach, metabolic, alpha, rho, rest = argument(frame, 7, 8, dtype)
        points, cells, shaped, patch, count = argument(frame, 8, 5, np.int32)
        nutrient = result(frame, 0, (points, points), dtype)  # where the argument was
        centres, directions = argument(frame, 1, (cells, 2), dtype), argument(frame, 2, (cells, 2), dtype)
        halves = argument(frame, 3, cells, dtype), argument(frame, 4, cells, dtype)
        shapes = (*halves, argument(frame, 5, shaped, dtype))
        weights, grid = argument(frame, 6, cells, dtype), (origin, spacing, patch)
        diffusion = alpha, rho, count
        eat(nutrient, centres, directions, shapes, weights, grid, (union, reach), metabolic, diffusion, rest)
        return NULL

    return call


def nutrient(dtype: Any) -> Call:
    """Of `compiled_nutrient_at`."""

    def call(frame: Any) -> int:
        if is_question(frame):
            return NULL
        points, room, count = argument(frame, 2, 3, np.int32)
        half, spacing = argument(frame, 3, 2, dtype)
        nutrient, positions = argument(frame, 0, (points, points), dtype), argument(frame, 1, (room, 2), dtype)
        read_nutrient(nutrient, positions, count, half, spacing, result(frame, 0, room, dtype))
        return NULL

    return call


def gradient(dtype: Any) -> Call:
    """Of `compiled_gradient_at`."""

    def call(frame: Any) -> int:
        if is_question(frame):
            return NULL
        points, room, count = argument(frame, 2, 3, np.int32)
        half, spacing = argument(frame, 3, 2, dtype)
        nutrient, positions = argument(frame, 0, (points, points), dtype), argument(frame, 1, (room, 2), dtype)
        read_gradient(nutrient, positions, count, half, spacing, result(frame, 0, (room, 2), dtype))
        return NULL

    return call


def ranking(dtype: Any) -> Call:
    """Of `CompiledGlobalBirths`."""

    def call(frame: Any) -> int:
        if is_question(frame):
            return NULL
        (room,) = argument(frame, 1, 1, np.int32)
        result(frame, 0, room, np.int32)[:] = np.argsort(argument(frame, 0, room, dtype), kind="mergesort")
        return NULL

    return call


def covering(dtype: Any) -> Call:
    """Of `CompiledSnapshot`."""

    def call(frame: Any) -> int:
        if is_question(frame):
            return NULL
        origin, spacing, union, reach = argument(frame, 6, 4, dtype)
        points, cells, shaped, patch = argument(frame, 7, 4, np.int32)
        centres, directions = argument(frame, 0, (cells, 2), dtype), argument(frame, 1, (cells, 2), dtype)
        halves = argument(frame, 2, cells, dtype), argument(frame, 3, cells, dtype)
        shapes = (*halves, argument(frame, 4, shaped, dtype))
        weights, grid = argument(frame, 5, cells, dtype), (origin, spacing, patch)
        cover_all(result(frame, 0, (points, points), dtype), centres, directions, shapes, weights, grid, union, reach)
        return NULL

    return call
