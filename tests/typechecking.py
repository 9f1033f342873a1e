"""The run-time type checker of the tests: beartype, taking whole numbers for real ones as static checkers do.

beartype writes and compiles a checker of each function, which takes a third of an import. Here it does so when the
function is first called: whatever runs is checked, and what no test of a process calls is not compiled.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any

from beartype import BeartypeConf, beartype

CONFIGURATION = BeartypeConf(is_pep484_tower=True)


def check(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with arguments and result checked."""
    checked: Callable[..., Any] | None = None

    @wraps(function)
    def when_called(*args: Any, **kwargs: Any) -> Any:
        nonlocal checked
        if checked is None:
            checked = beartype(conf=CONFIGURATION)(function)
        return checked(*args, **kwargs)

    return when_called
