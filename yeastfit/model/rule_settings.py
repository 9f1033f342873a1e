"""Settings of rules: their fields, which are fixed while a model runs."""

from collections.abc import Mapping
from dataclasses import fields
from math import isfinite
from numbers import Integral, Real
from typing import Any

from yeastfit.errors import InputError
from yeastfit.storage import as_json
from yeastfit.text import quoted


def check_settings(rule: Any) -> None:
    """Raise `InputError` where a field that is to be a number is none of its kind, or one holds a list of rules."""
    for each in fields(rule):
        value = getattr(rule, each.name)
        held = value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ()
        listed = any(hasattr(one, "question") for one in held)
        if expected := "no list of rules: give each a field of its own" if listed else _unlike(value, each.type):
            name = getattr(rule, "name", type(rule).__name__)
            raise InputError(f"{rule.question}: {each.name} of rule {name!r} is {quoted(value)}, expected {expected}")


def in_a_file(rule: Any, name: str) -> Any:
    """A setting as files keep it.

    Raises:
        InputError: It is nothing of which JSON knows.
    """
    value = getattr(rule, name)
    try:
        as_json(value)
    except TypeError:
        raise InputError(
            f"{rule.question}: {name} of rule {rule.name!r} is {quoted(value)}, which no file can keep: settings are "
            "numbers, texts, lists of these, and rules; write anything else into the rule itself"
        ) from None
    return value


def _unlike(value: Any, kind: Any) -> str | None:
    """What is expected in place of a value; None where it is a number of its kind, or no number is expected."""
    if kind in (int, "int") and (isinstance(value, bool) or not isinstance(value, Integral)):
        return "a whole number"
    if kind in (float, "float") and (isinstance(value, bool) or not isinstance(value, Real) or not isfinite(value)):
        return "a finite number"
    return None
