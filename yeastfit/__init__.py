"""yeastfit: yeast colonies in JAX - simulated, measured in micrographs, and fitted."""

from yeastfit.derivatives import check_derivatives
from yeastfit.errors import InputError
from yeastfit.gradient_check import GradientCheck
from yeastfit.gradients import check_gradients
from yeastfit.infer.choices import Design
from yeastfit.infer.design import design
from yeastfit.infer.experiment import information_of
from yeastfit.infer.fit import fit
from yeastfit.infer.fitted import Fit
from yeastfit.infer.information import information
from yeastfit.infer.information_result import Information
from yeastfit.infer.sensitivity import sensitivity
from yeastfit.infer.sensitivity_result import Sensitivity
from yeastfit.infer.settings import FitSettings
from yeastfit.infer.targets import Targets
from yeastfit.infer.uncertainty import explore
from yeastfit.measure.dataset import Dataset, read_dataset
from yeastfit.measure.series import measure_dataset, measure_file
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import PARAMETERS, Parameters, Scales
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.simulation import member_keys, simulate
from yeastfit.simulation_result import Simulation

__version__ = "0.1.0"
__all__ = [
    "HARD",
    "PARAMETERS",
    "Dataset",
    "Design",
    "Fit",
    "FitSettings",
    "GradientCheck",
    "Information",
    "InputError",
    "Numerics",
    "Parameters",
    "Relaxation",
    "Scales",
    "Sensitivity",
    "Simulation",
    "Targets",
    "check_derivatives",
    "check_gradients",
    "design",
    "explore",
    "fit",
    "information",
    "information_of",
    "measure_dataset",
    "measure_file",
    "member_keys",
    "read_dataset",
    "sensitivity",
    "simulate",
]
