"""The run-time type checker of the tests: beartype, taking whole numbers for real ones as static checkers do.

jaxtyping's import hook has two checkers written and compiled for each function where it is defined, which takes half of
an import, and calls both around the function. Here a function has one checker, made when the function is first called:
whatever runs is checked. Where no array is among its annotations there are no lengths that must agree, and beartype
checks alone.
"""

import dataclasses
import inspect
import typing
from collections.abc import Callable
from functools import wraps
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype

CONFIGURATION = BeartypeConf(is_pep484_tower=True)
TYPES_OF_ARRAYS = (type(jaxtyping.AbstractArray), type(jaxtyping.PyTree))
jaxtyped = jaxtyping.jaxtyped


def check(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with arguments and result checked."""
    return beartype(conf=CONFIGURATION)(function)


def check_when_called(target: Any = None, **_: Any) -> Any:
    """What jaxtyping's hook decorates: a function, a method, or a class, of which the `__init__` of dataclasses."""
    if target is None:
        return check_when_called
    if inspect.isclass(target):
        if dataclasses.is_dataclass(target) and not hasattr(target.__init__, "checked_when_called"):
            target.__init__ = _when_called(target.__init__)  # type: ignore[method-assign]
        return target
    if isinstance(target, classmethod | staticmethod):
        return type(target)(_when_called(target.__func__))
    if isinstance(target, property):
        return property(target.fget and _when_called(target.fget), target.fset and _when_called(target.fset))
    return _when_called(target)


def _when_called(function: Callable[..., Any]) -> Callable[..., Any]:
    checked: Callable[..., Any] | None = None

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal checked
        if jaxtyping.config.jaxtyping_disable:
            return function(*args, **kwargs)
        if checked is None:
            checked = _checked(function)
        return checked(*args, **kwargs)

    call.checked_when_called = True  # type: ignore[attr-defined]
    return call


def _checked(function: Callable[..., Any]) -> Callable[..., Any]:
    try:
        hints = typing.get_type_hints(function, include_extras=True)
    except Exception:  # of names that only static checkers see: jaxtyping leaves those arguments unchecked
        hints = {}
    if not hints or inspect.isgeneratorfunction(inspect.unwrap(function)):  # which beartype would check as it runs
        return jaxtyped(function, typechecker=check)
    function.__annotations__ = hints
    return jaxtyped(check(function), typechecker=None) if any(map(_has_arrays, hints.values())) else check(function)


def _has_arrays(hint: Any) -> bool:
    if isinstance(hint, TYPES_OF_ARRAYS):
        return True
    if isinstance(hint, list):  # the arguments of a callable
        return any(map(_has_arrays, hint))
    return any(map(_has_arrays, typing.get_args(hint)))
