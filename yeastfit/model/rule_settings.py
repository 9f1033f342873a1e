"""Settings of rules: their fields, which are fixed while a model runs."""

from dataclasses import fields
from math import isfinite
from numbers import Integral, Real
from typing import Any

from yeastfit.errors import InputError
from yeastfit.text import quoted


def check_settings(rule: Any) -> None:
    """Raise `InputError` where a field that is to be a number is none, or none of its kind."""
    for each in fields(rule):
        value = getattr(rule, each.name)
        if expected := _unlike(value, each.type):
            name = getattr(rule, "name", type(rule).__name__)
            raise InputError(f"{rule.question}: {each.name} of rule {name!r} is {quoted(value)}, expected {expected}")


def _unlike(value: Any, kind: Any) -> str | None:
    """What is expected in place of a value; None where it is a number of its kind, or no number is expected."""
    if kind in (int, "int") and (isinstance(value, bool) or not isinstance(value, Integral)):
        return "a whole number"
    if kind in (float, "float") and (isinstance(value, bool) or not isinstance(value, Real) or not isfinite(value)):
        return "a finite number"
    return None
