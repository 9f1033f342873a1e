"""yeastfit: yeast colonies in JAX - simulated, measured in micrographs, and fitted.

Each public name is imported when it is first asked for, as `__init__.pyi` says, so that who needs little waits little.
"""

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """A public name, imported where it is defined."""
    if name == "__version__":
        from importlib.metadata import version

        return version("yeastfit")
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _public(name)
