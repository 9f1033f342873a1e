"""Measure colonies, photographed or simulated.

Public names, those of `__init__.pyi`, are imported when they are first asked for: simulations are measured with JAX,
images without.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
