"""The public names: where each is defined, for type checkers and for `__init__.py`."""

from . import measure, model, plot
from .derivatives.check import check_derivatives
from .derivatives.check_colony import check_gradients
from .derivatives.result import GradientCheck
from .errors import InputError, SimulationError
from .inference.calibration import calibrate
from .inference.colony_simulator import ColonySimulator
from .inference.comparison.conditions import ConditionComparison
from .inference.comparison.cross_validation import cross_validate
from .inference.comparison.left_out import LeftOut
from .inference.comparison.models import ModelComparison
from .inference.fit.bootstrap_profile import explore, profiles
from .inference.fit.least_squares import fit
from .inference.fit.result import Fit, FitStatus
from .inference.fit.settings import FitSettings
from .inference.imaging import Imaging
from .inference.information.design import design
from .inference.information.design_result import Design
from .inference.information.experiment import information_of
from .inference.information.fisher import information
from .inference.information.result import Information, InformationStatus
from .inference.li2024 import LI2024
from .inference.models.forward_model import ForwardModel, Seen
from .inference.models.grown import Grown
from .inference.models.registry import FORWARD_MODELS
from .inference.posterior.calibration_ranks import Calibration
from .inference.posterior.diagnostics import Diagnostics
from .inference.posterior.problem import Problem
from .inference.posterior.result import Posterior
from .inference.posterior.sampler import Sampler
from .inference.posterior.settings import Setting
from .inference.posterior.status import Status
from .inference.prior.prior import Prior
from .inference.prior.variation import Variation
from .inference.resolution import Resolution
from .inference.samplers import SAMPLERS, infer
from .inference.sensitivity.estimate import sensitivity
from .inference.sensitivity.pathwise import robust_mean
from .inference.sensitivity.result import Sensitivity, SensitivityStatus
from .inference.simulator import Simulator
from .inference.store.cached_simulator import CachedSimulator
from .inference.store.simulation_store import Store
from .inference.targets import Targets
from .inference.workers.spread import Spread, Workers
from .measure.measure_images import measure_dataset, measure_file
from .measure.reading.dataset import Dataset, read_dataset
from .measure.statistics.registry import STATISTICS, register_statistic
from .measure.statistics.statistic import Statistic
from .model.model import RULES, Model
from .model.numerics import Numerics
from .model.parameters import PARAMETERS, Parameters, Scales
from .model.relaxation import HARD, Relaxation
from .model.rules import (
    BirthRule,
    Births,
    BuddingRule,
    ContactRule,
    Context,
    DeathRule,
    DetachmentRule,
    FluctuationRule,
    MediumRule,
    MotionRule,
    ShapeRule,
    SpringRule,
    UptakeRule,
)
from .numbers import Range
from .observable import Observable
from .panel import Panel
from .parameter_set import Parameter, ParameterSet
from .processors import available_processors
from .simulation.recipe import read_truth
from .simulation.result import Simulation
from .simulation.simulate import member_keys, simulate
from .specification import Specification

__version__: str
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
    "Calibration",
    "ColonySimulator",
    "ConditionComparison",
    "ContactRule",
    "Context",
    "Dataset",
    "DeathRule",
    "Design",
    "DetachmentRule",
    "Diagnostics",
    "Fit",
    "FitSettings",
    "FitStatus",
    "FluctuationRule",
    "ForwardModel",
    "GradientCheck",
    "Grown",
    "Imaging",
    "Information",
    "InformationStatus",
    "InputError",
    "LeftOut",
    "MediumRule",
    "Model",
    "ModelComparison",
    "MotionRule",
    "Numerics",
    "Observable",
    "Panel",
    "Parameter",
    "ParameterSet",
    "Parameters",
    "Posterior",
    "Prior",
    "Problem",
    "Range",
    "Relaxation",
    "Resolution",
    "Sampler",
    "Scales",
    "Seen",
    "Sensitivity",
    "SensitivityStatus",
    "Setting",
    "ShapeRule",
    "Simulation",
    "SimulationError",
    "Simulator",
    "Specification",
    "Spread",
    "SpringRule",
    "Statistic",
    "Status",
    "Store",
    "Targets",
    "UptakeRule",
    "Variation",
    "Workers",
    "available_processors",
    "calibrate",
    "check_derivatives",
    "check_gradients",
    "cross_validate",
    "design",
    "explore",
    "fit",
    "infer",
    "information",
    "information_of",
    "measure",
    "measure_dataset",
    "measure_file",
    "member_keys",
    "model",
    "plot",
    "profiles",
    "read_dataset",
    "read_truth",
    "register_statistic",
    "robust_mean",
    "sensitivity",
    "simulate",
]
