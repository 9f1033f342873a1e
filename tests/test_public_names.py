"""The public names of the package and of its rooms: whoever changes them decides to change these lists.

Those of `yeastfit.plot` are pinned in plot/test_names.py.
"""

import subprocess
import sys

import yeastfit
from yeastfit import measure, model, offlattice


def test_the_package() -> None:
    names = """
    FORWARD_MODELS HARD LI2024 PARAMETERS RULES SAMPLERS STATISTICS BirthRule Births BuddingRule CachedSimulator
    Calibration ColonySimulator ConditionComparison ContactRule Context Dataset DeathRule Design DetachmentRule
    Diagnostics Fit FitSettings FitStatus FluctuationRule ForwardModel GradientCheck Grown Imaging Information
    InputError LeftOut MediumRule Model ModelComparison MotionRule Numerics Observable Panel Parameter
    ParameterSet Parameters Posterior Prior Problem Range Relaxation Resolution Sampler Scales Seen Sensitivity
    Setting ShapeRule Simulation SimulationError Simulator Specification Spread SpringRule Statistic Status
    Store Targets UptakeRule Variation Workers
    available_processors calibrate check_derivatives check_gradients cross_validate design explore fit infer
    information information_of measure measure_dataset measure_file member_keys model plot profiles read_dataset
    read_truth register_statistic robust_mean sensitivity simulate
    """
    assert sorted(yeastfit.__all__) == sorted(names.split())
    assert all(hasattr(yeastfit, name) for name in yeastfit.__all__)


def test_the_model() -> None:
    names = "Cells Colony Snapshot TurnedBudding biomass cells_of level_set start"
    assert model.__all__ == names.split()
    assert all(hasattr(model, name) for name in model.__all__)


def test_measuring() -> None:
    names = "HardStatistics Indicator Pixels SmoothStatistics measure_mask node_statistics"
    assert measure.__all__ == names.split()
    assert all(hasattr(measure, name) for name in measure.__all__)


def test_the_off_lattice_model() -> None:
    names = (
        "BinnedOutlines Ellipses OfflatticeColony OfflatticeSimulator grow grow_many match_exactly search_from_below"
    )
    assert sorted(offlattice.__all__) == names.split()
    assert all(hasattr(offlattice, name) for name in offlattice.__all__)
    assert not hasattr(offlattice, "shrink")


def test_numba_is_imported_where_colonies_grow() -> None:
    said = "import sys, yeastfit.offlattice.parameters; print('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", said], capture_output=True, text=True).stdout == "False\n"
