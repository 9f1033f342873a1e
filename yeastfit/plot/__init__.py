"""Figures: every function takes a result and returns a matplotlib figure, which `save` writes::

from yeastfit import plot

plot.save(plot.fit(result), "fit.png")
"""

from yeastfit.plot.corner_plot import corner
from yeastfit.plot.fits import bootstrap, convergence, fit, profiles
from yeastfit.plot.information import design, ellipses, spectrum
from yeastfit.plot.measured_curves import condition_curves
from yeastfit.plot.micrographs import overlay, thumbnail, thumbnail_sheet
from yeastfit.plot.posterior import colonies, cross_validation, predictive, ranks, traces
from yeastfit.plot.simulations import colony, curves
from yeastfit.plot.style import save

__all__ = [
    "bootstrap",
    "colonies",
    "colony",
    "condition_curves",
    "convergence",
    "corner",
    "cross_validation",
    "curves",
    "design",
    "ellipses",
    "fit",
    "overlay",
    "predictive",
    "profiles",
    "ranks",
    "save",
    "spectrum",
    "thumbnail",
    "thumbnail_sheet",
    "traces",
]
