"""The public names of `yeastfit.plot`, and where each is defined."""

from .comparisons import left_out, marginals
from .corner_plot import corner
from .fits import bootstrap, convergence, fit, profiles
from .information import design, ellipses, spectrum
from .measured_curves import condition_curves
from .micrographs import overlay, thumbnail, thumbnail_sheet
from .movies import movie
from .posterior import colonies, cross_validation, predictive, ranks, traces
from .simulations import colony, curves
from .style import save

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
    "left_out",
    "marginals",
    "movie",
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
