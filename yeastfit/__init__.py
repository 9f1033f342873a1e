"""yeastfit: yeast colonies in JAX - simulated, measured in micrographs, and fitted."""

import importlib
from importlib.metadata import version
from types import ModuleType
from typing import TYPE_CHECKING

from yeastfit.derivatives.check import check_derivatives
from yeastfit.derivatives.check_colony import check_gradients
from yeastfit.derivatives.result import GradientCheck
from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.colony_simulator import ColonySimulator, Resolution
from yeastfit.inference.fit.bootstrap_profile import explore, profiles
from yeastfit.inference.fit.least_squares import fit
from yeastfit.inference.fit.result import Fit, FitStatus
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.forward_models import FORWARD_MODELS, ForwardModel
from yeastfit.inference.imaging import Imaging
from yeastfit.inference.information.design import design
from yeastfit.inference.information.design_result import Design
from yeastfit.inference.information.experiment import information_of
from yeastfit.inference.information.fisher import information
from yeastfit.inference.information.result import Information
from yeastfit.inference.li2024 import LI2024
from yeastfit.inference.posterior.cached_simulator import CachedSimulator
from yeastfit.inference.posterior.diagnostics import Diagnostics
from yeastfit.inference.posterior.prior import Prior
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.settings import Setting
from yeastfit.inference.posterior.simulation_store import Store
from yeastfit.inference.posterior.status import Status
from yeastfit.inference.samplers import SAMPLERS, infer
from yeastfit.inference.sensitivity.estimate import sensitivity
from yeastfit.inference.sensitivity.pathwise import robust_mean
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.inference.simulator import Simulator
from yeastfit.inference.targets import Targets
from yeastfit.measure.measure_images import measure_dataset, measure_file
from yeastfit.measure.reading.dataset import Dataset, read_dataset
from yeastfit.measure.statistics.registry import STATISTICS, register_statistic
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.model.model import RULES, Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import PARAMETERS, Parameters, Scales
from yeastfit.model.relaxation import HARD, Relaxation
from yeastfit.model.rules import (
    BirthRule,
    Births,
    BuddingRule,
    ContactRule,
    Context,
    DeathRule,
    UptakeRule,
)
from yeastfit.observable import Observable
from yeastfit.parameter_set import Parameter, ParameterSet
from yeastfit.processors import available_processors
from yeastfit.simulation.result import Simulation
from yeastfit.simulation.simulate import member_keys, simulate
from yeastfit.simulation.synthetic_data import read_truth

if TYPE_CHECKING:
    from yeastfit import plot

__version__ = version("yeastfit")
__all__ = [
    "FORWARD_MODELS",
    "HARD",
    "LI2024",
    "PARAMETERS",
    "RULES",
    "SAMPLERS",
    "STATISTICS",
    "BirthRule",
    "Births",
    "BuddingRule",
    "CachedSimulator",
    "ColonySimulator",
    "ContactRule",
    "Context",
    "Dataset",
    "DeathRule",
    "Design",
    "Diagnostics",
    "Fit",
    "FitSettings",
    "FitStatus",
    "ForwardModel",
    "GradientCheck",
    "Imaging",
    "Information",
    "InputError",
    "Model",
    "Numerics",
    "Observable",
    "Parameter",
    "ParameterSet",
    "Parameters",
    "Posterior",
    "Prior",
    "Problem",
    "Relaxation",
    "Resolution",
    "Scales",
    "Sensitivity",
    "Setting",
    "Simulation",
    "SimulationError",
    "Simulator",
    "Statistic",
    "Status",
    "Store",
    "Targets",
    "UptakeRule",
    "available_processors",
    "check_derivatives",
    "check_gradients",
    "design",
    "explore",
    "fit",
    "infer",
    "information",
    "information_of",
    "measure_dataset",
    "measure_file",
    "member_keys",
    "plot",
    "profiles",
    "read_dataset",
    "read_truth",
    "register_statistic",
    "robust_mean",
    "sensitivity",
    "simulate",
]


def __getattr__(name: str) -> ModuleType:
    """`yeastfit.plot`, imported when it is first asked for, as it brings matplotlib."""
    if name == "plot":
        return importlib.import_module("yeastfit.plot")
    raise AttributeError(f"module 'yeastfit' has no attribute {name!r}")
