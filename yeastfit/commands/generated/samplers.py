"""Options for the settings of samplers, each of all methods that have it."""

import functools
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields
from typing import Any

from yeastfit.commands.generated.options import Option, flag_of, hints_of, plain_kind
from yeastfit.inference.posterior.settings import Setting
from yeastfit.inference.samplers import SAMPLERS

PANEL = "Settings of the method"


class SamplerOptions:
    """An option for each setting of a registered sampler; the command receives those given, by name."""

    def options(self, arguments: Sequence[str]) -> list[Option]:
        """Of all methods."""
        found = dict[str, Option]()
        for sampler in SAMPLERS.values():
            hints = hints_of(sampler)
            for name, (_, setting) in _fields(sampler).items():
                kind, choices = plain_kind(hints[name])
                if kind is None or name in found:
                    continue
                flags = tuple(flag_of(one) for one in (name, *setting.aliases))
                flags = tuple(f"{flag}/--no-{flag[2:]}" for flag in flags) if kind is bool else flags
                text = f"{setting.help} {_defaults(name)}".strip()
                found[name] = Option(name, kind, text, PANEL, flags, choices=choices)
        return list(found.values())

    def read(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """As they are."""
        return dict(given)


def extending(method: str) -> tuple[str, ...]:
    """Settings of a method that merely make a run longer."""
    return tuple(name for name, (_, one) in _fields(SAMPLERS[method]).items() if one.extends)


@functools.cache
def _fields(sampler: type) -> dict[str, tuple[Field, Setting]]:
    """Its fields, with what is said of them."""
    hints = typing.get_type_hints(sampler, include_extras=True)
    annotated = {one.name: getattr(hints[one.name], "__metadata__", ()) for one in fields(sampler)}
    return {
        one.name: (one, next((data for data in annotated[one.name] if isinstance(data, Setting)), Setting("")))
        for one in fields(sampler)
    }


def _defaults(name: str) -> str:
    """Methods that have a setting, with their defaults."""
    having = {method: _fields(sampler)[name] for method, sampler in SAMPLERS.items() if name in _fields(sampler)}
    each = [
        method if one.default in (None, MISSING) else f"{method} {one.default}" for method, (one, _) in having.items()
    ]
    return f"({', '.join(each)})"
