"""Classes of arguments, looked at before anything is asked of an object: what is wrong is then the argument's name."""

from collections.abc import Mapping
from typing import Any

from yeastfit.errors import InputError
from yeastfit.text import quoted


def check_kind(name: str, value: Any, kind: type, write: str = "") -> None:
    """Raise `InputError` where an argument is not of its class.

    Arguments:
        name: Of the argument.
        value: What was given.
        kind: The class.
        write: How to make one; by default yeastfit's class of that name.
    """
    if isinstance(value, type) and issubclass(value, kind):
        raise InputError(f"{name} is the class {value.__name__}: write {value.__name__}(…)")
    if not isinstance(value, kind):
        raise InputError(f"{name} is {quoted(value)}, it must be {write or f'yeastfit.{kind.__name__}(…)'}")


def check_named(name: str, values: Any, kind: type, write: str) -> None:
    """Raise `InputError` where an argument is no mapping from names to objects of a class, or an empty one."""
    check_kind(name, values, Mapping, f"{write}, by name")
    if not values:
        raise InputError(f"{name} are empty, need at least one: {write}, by name")
    for key, value in values.items():
        check_kind(f"{name}: {quoted(key)}", value, kind, write)


def check_list(name: str, value: Any) -> None:
    """Raise `InputError` where a list of names is one text: nobody means its letters."""
    if isinstance(value, str):
        raise InputError(f"{name} is {quoted(value)}, it must be a list of names, such as [{quoted(value)}]")
