"""What a method reports of its own run: a typed record that a posterior saves, loads, and shows on its page.

A method's report is a frozen dataclass derived from `Diagnostics`. Fields may be numbers, strings, arrays, tuples and
further dataclasses; their annotations say how they are read back.
"""

import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from importlib import import_module
from typing import Any, ClassVar, Union, get_args, get_origin

import numpy as np

from yeastfit.errors import InputError

METHODS = "yeastfit.inference.samplers"
"""Imports all methods of the package, which stand above this file, and with them their diagnostics."""


@dataclass(frozen=True)
class Diagnostics:
    """Diagnostics of a method; this one has nothing to report.

    Attributes:
        caption: What the numbers mean, for the page of a posterior.
    """

    caption: ClassVar[str] = ""
    kinds: ClassVar[dict[str, type["Diagnostics"]]] = {}

    def __init_subclass__(cls) -> None:
        Diagnostics.kinds[cls.__name__] = cls

    def sentences(self) -> list[str]:
        """What is wrong; empty where all is well."""
        return []

    def facts(self) -> list[tuple[str, str]]:
        """Names and values for the page of a posterior."""
        return []

    def rows(self) -> list[dict[str, Any]]:
        """A table for the page of a posterior: a row per round or population; all rows have the same keys."""
        return []

    def asdict(self) -> dict[str, Any]:
        """Plain data, from which `restored` makes the same again."""
        return plain(self)

    @staticmethod
    def restored(data: Mapping[str, Any]) -> "Diagnostics":
        """What `asdict` gave.

        Raises:
            InputError: The kind is unknown: the file that defines it must be imported first.
        """
        kind = data.get("kind")
        if kind not in {"Diagnostics", *Diagnostics.kinds}:
            import_module(METHODS)
        if kind not in {"Diagnostics", *Diagnostics.kinds}:
            raise InputError(f"diagnostics are of kind {kind!r}, which no imported file defines")
        return _read(Diagnostics if kind == "Diagnostics" else Diagnostics.kinds[kind], data)


def plain(value: Any) -> Any:
    """A value as plain data: dataclasses become dictionaries with their name as `kind`, tuples lists; arrays stay."""
    if is_dataclass(value) and not isinstance(value, type):
        named = {one.name: plain(getattr(value, one.name)) for one in fields(value)}
        return {"kind": type(value).__name__, **named}
    return [plain(one) for one in value] if isinstance(value, tuple | list) else value


def _read(hint: Any, data: Any) -> Any:
    """A value of the type that an annotation says."""
    choices = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    if isinstance(data, Mapping):
        kind: Any = next(one for one in choices if getattr(one, "__name__", "") == data["kind"])
        hints = typing.get_type_hints(kind)
        return kind(**{one.name: _read(hints[one.name], data[one.name]) for one in fields(kind)})
    if not isinstance(data, list):
        return data
    if get_origin(hint) is tuple:
        inner = get_args(hint)
        each = [inner[0]] * len(data) if inner[-1] is Ellipsis else inner
        return tuple(_read(one, value) for one, value in zip(each, data, strict=True))
    return np.array(data, dtype=float)
