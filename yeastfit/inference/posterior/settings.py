"""Settings of samplers and models: what the command line says about a field, and checks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from yeastfit.errors import InputError
from yeastfit.memory import check_count
from yeastfit.numbers import Range


@dataclass(frozen=True)
class Setting:
    """What the command line says of a field of a sampler or model: `Annotated[int, Setting("Number of chains.")]`.

    Fields without it are options, too, where they are numbers, strings or choices.

    Attributes:
        help: One line for a user who does not know the method.
        aliases: Further names of the option.
        extends: Whether a larger value merely makes a run longer, so that a resumed run may have it.
        commands: Those that have the option; empty for all.
        defaults: By command, where they are not the field's own.
        negative: Name of the option that turns it off, without dashes, where that is not no-NAME.
    """

    help: str
    aliases: tuple[str, ...] = ()
    extends: bool = False
    commands: tuple[str, ...] = ()
    defaults: Mapping[str, Any] = field(default_factory=dict, hash=False)
    negative: str = ""


def check_at_least(sampler: Any, **least: int) -> None:
    """Raise `InputError` where a setting is neither None nor a whole number from its least on, or is too many."""
    for name, bound in least.items():
        value = getattr(sampler, name)
        if value is not None:
            check_count(name, Range(bound).read_whole(value, name))


def check_choice(sampler: Any, name: str, choices: Sequence[str]) -> None:
    """Raise `InputError` where a setting is none of its choices."""
    value = getattr(sampler, name)
    if value not in choices:
        raise InputError(f"{name} is {value!r}, it must be one of {', '.join(choices)}")
