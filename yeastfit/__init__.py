"""yeastfit: yeast colonies in JAX - simulated, measured in micrographs, and fitted."""

from yeastfit.errors import InputError
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import PARAMETERS, Parameters, Scales
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.simulation import Simulation, member_keys, simulate

__version__ = "0.1.0"
__all__ = [
    "HARD",
    "PARAMETERS",
    "InputError",
    "Numerics",
    "Parameters",
    "Relaxation",
    "Scales",
    "Simulation",
    "member_keys",
    "simulate",
]
