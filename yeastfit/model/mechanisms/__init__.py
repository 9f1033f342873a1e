"""Rules beyond the source's own, one mechanism a file; whatever rule a file of this folder defines can be chosen.

The source's rules are in the folder `laws`.
"""

from importlib import import_module
from pkgutil import iter_modules

from yeastfit.model.rules import Rule


def every_rule() -> list[type[Rule]]:
    """All rules with a name that the files of this folder define, in the order of the files."""
    modules = [import_module(f"{__name__}.{one.name}") for one in iter_modules(__path__)]
    return [
        value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Rule) and value.__module__ == module.__name__
        if "name" in vars(value)
    ]
