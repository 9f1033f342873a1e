"""How an object can be made again in another process: a function by its import path, and plain arguments.

A compiled program, or a function of JAX, must not travel between processes. What travels is text: the path of the
function that makes the object, the arguments as JSON, and modules that have to be imported first.
"""

import hashlib
import importlib
import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from yeastfit.errors import InputError
from yeastfit.storage import as_json, from_json

MAIN = "__main__"


@dataclass(frozen=True)
class Specification:
    """A recipe for an object.

    Attributes:
        function: What makes it, as "module:function"; a class will do.
        arguments: By name, values that JSON can hold.
        imports: Modules that are imported first, such as one that registers a rule.

    Raises:
        InputError: The function's path has no module, or is that of a program that other processes cannot import.
    """

    function: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    imports: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        module, _, name = self.function.partition(":")
        if not module or not name:
            raise InputError(f"function is {self.function!r}, it must be a path such as 'package.module:function'")
        for each, what in ((module, name), *((one, "something that it needs") for one in self.imports)):
            if each == MAIN:
                raise InputError(
                    f"specification: {what} is defined in the program that runs, other processes cannot import it: "
                    "move it into a module of its own"
                )

    @property
    def text(self) -> str:
        """All of it, for another process."""
        return as_json({"function": self.function, "arguments": dict(self.arguments), "imports": list(self.imports)})

    @property
    def digest(self) -> str:
        """SHA-256 of the text."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @staticmethod
    def read(text: str) -> "Specification":
        """From `text`."""
        found = from_json(text)
        return Specification(found["function"], found["arguments"], tuple(found["imports"]))

    def made(self) -> Any:
        """The object.

        Raises:
            InputError: A module or the function is not there.
        """
        for each in self.imports:
            _imported(each)
        return found_at(self.function)(**self.arguments)


def found_at(path: str) -> Any:
    """The function or class of a path "module:function".

    Raises:
        InputError: It is not there.
    """
    module, _, name = path.partition(":")
    found = _imported(module)
    for part in name.split("."):
        if not hasattr(found, part):
            raise InputError(f"specification: {module} has no {name} here")
        found = getattr(found, part)
    return found


def _imported(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise InputError(f"specification: {module} cannot be imported here: {error}") from error


def path_of(function: Any) -> str:
    """The import path of a function or class, as `Specification.function` has it."""
    return f"{function.__module__}:{function.__qualname__}"


def module_outside(thing: Any) -> tuple[str, ...]:
    """The module of a function or class, unless it is one of the package."""
    module = thing.__module__
    return () if module.partition(".")[0] == "yeastfit" else (module,)


def source_digest(thing: Any) -> str:
    """The beginning of the SHA-256 of a function's or class's source; "unknown" where there is no file of it."""
    try:
        return hashlib.sha256(inspect.getsource(thing).encode()).hexdigest()[:12]
    except (OSError, TypeError):
        return "unknown"


def described(function: Any) -> dict[str, Any]:
    """A function, or a `functools.partial` of one with named arguments, as plain data; `undescribed` reads it."""
    if isinstance(function, partial):
        return {"function": path_of(function.func), "arguments": dict(function.keywords)}
    return {"function": path_of(function), "arguments": {}}


def undescribed(plain: Mapping[str, Any]) -> Any:
    """The function of `described`."""
    function = found_at(plain["function"])
    return partial(function, **plain["arguments"]) if plain["arguments"] else function
