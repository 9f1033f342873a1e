"""The off-lattice model of Li et al. 2024: `grow` colonies, draw their first cells as masks, then measure these.

Public names, those of `__init__.pyi`, are imported when they are first asked for, as they bring numba.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
