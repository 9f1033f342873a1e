"""The public names of the package and of its rooms: whoever changes them decides to change these lists.

Those of `yeastfit.plot` are pinned in plot/test_names.py. What takes arguments says what each is.
"""

import inspect
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import yeastfit
from yeastfit import measure, model, offlattice, plot
from yeastfit.model.rules import Rule


def test_the_package() -> None:
    names = """
    FORWARD_MODELS HARD LI2024 PARAMETERS RULES SAMPLERS STATISTICS BirthRule Births BuddingRule CachedSimulator
    Calibration ColonySimulator ConditionComparison ContactRule Context Dataset DeathRule Design DetachmentRule
    Diagnostics Fit FitSettings FitStatus FluctuationRule ForwardModel GradientCheck Grown Imaging Information
    InformationStatus InputError LeftOut MediumRule Model ModelComparison MotionRule Numerics Observable Panel Parameter
    ParameterSet Parameters Posterior Prior Problem Range Relaxation Resolution Sampler Scales Seen Sensitivity
    SensitivityStatus Setting ShapeRule Simulation SimulationError Simulator Specification Spread SpringRule Statistic
    Status Store Targets UptakeRule Variation Workers
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
    names = "COLONY_ERRORS HardStatistics Indicator OUTLINE_ERRORS Pixels SmoothStatistics measure_mask node_statistics"
    assert measure.__all__ == names.split()
    assert all(hasattr(measure, name) for name in measure.__all__)


def test_the_off_lattice_model() -> None:
    names = (
        "BinnedOutlines Ellipses OfflatticeColony OfflatticeSimulation OfflatticeSimulator grow grow_many "
        "match_exactly search_from_below simulate_offlattice"
    )
    assert sorted(offlattice.__all__) == names.split()
    assert all(hasattr(offlattice, name) for name in offlattice.__all__)
    assert not hasattr(offlattice, "shrink")


def test_numba_is_imported_where_colonies_grow() -> None:
    said = "import sys, yeastfit.offlattice.parameters; print('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", said], capture_output=True, text=True).stdout == "False\n"


def callables() -> Iterator[tuple[str, Callable[..., Any], int]]:
    """Public functions and methods, each with the number of arguments from which on its docstring has sections.

    Methods of one argument say what it is in their first line, those of rules in what `Context` is.
    """
    for room in (yeastfit, measure, model, offlattice, plot):
        for name in room.__all__:
            thing = getattr(room, name)
            if inspect.isfunction(thing):
                yield name, thing, 1
            elif inspect.isclass(thing) and not (issubclass(thing, Rule) or thing.__module__ == Rule.__module__):
                for key, one in vars(thing).items():
                    method = getattr(one, "__func__", one)
                    if inspect.isfunction(method) and method.__module__.startswith("yeastfit") and key[0] != "_":
                        yield f"{name}.{key}", method, 2


def missing(function: Callable[..., Any], least: int) -> list[str]:
    """What a docstring lacks: arguments by name, and whether it says what is returned."""
    said, signature = inspect.getdoc(function) or "", inspect.signature(function)
    names = [name for name in signature.parameters if name not in ("self", "cls")]
    if len(names) < least:
        return [] if said else ["a docstring"]
    section = said.partition("Arguments:")[2].partition("\nR")[0]
    lacks = [name for name in names if f"    {name}: " not in section.replace("*", "")]
    returned = signature.return_annotation  # which the checker of types resolves when a function is first called
    its_class = function.__qualname__.partition(".")[0]
    constructs = isinstance(returned, str) or getattr(returned, "__name__", None) == its_class
    silent = returned in (None, type(None)) or constructs or "Returns:" in said or "Yields:" in said
    return lacks + ([] if silent else ["Returns"])


def test_public_names_say_what_they_take_and_return() -> None:
    found = {name: missing(function, least) for name, function, least in callables()}
    assert len(found) > 150
    assert {name: lacks for name, lacks in found.items() if lacks} == {}


def test_what_a_docstring_lacks_is_found() -> None:
    def silent(a: int, *b: int) -> int:
        """Sum.

        Arguments:
            a: One.
        """
        return a + sum(b)

    assert missing(silent, 1) == ["b", "Returns"]
    assert missing(silent, 3) == []
