"""Classes of arguments, looked at before anything is asked of an object: what is wrong is then the argument's name."""

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


def check_list(name: str, value: Any) -> None:
    """Raise `InputError` where a list of names is one text: nobody means its letters."""
    if isinstance(value, str):
        raise InputError(f"{name} is {quoted(value)}, it must be a list of names, such as [{quoted(value)}]")
