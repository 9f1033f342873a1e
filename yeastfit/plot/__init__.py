"""Figures: every function takes a result and returns a matplotlib figure, which `save` writes::

    from yeastfit import plot

    plot.save(plot.fit(result), "fit.png")

Public names, those of `__init__.pyi`, are imported when they are first asked for: a picture of simulated colonies needs
nothing of posteriors.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
