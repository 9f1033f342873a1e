"""Simulators of the conditions of a fit: colonies, or what was handed in."""

from collections.abc import Mapping, Sequence
from typing import Any

from yeastfit.errors import InputError
from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.inference.resolution import Resolution, usual_resolution
from yeastfit.inference.simulator import Simulator, check_simulator, inside
from yeastfit.inference.targets import Targets
from yeastfit.model.model import Model
from yeastfit.parameter_set import ParameterSet

Fixed = Mapping[str, float] | Mapping[str, Mapping[str, float]]
"""Values by name, for all conditions or by condition."""

Rules = dict[str, dict[str, Any]]
"""As `Model.asdict` has them."""

Simulators = dict[str, Simulator]
"""By condition."""


def colony_simulators(
    targets: Mapping[str, Targets],
    free: Sequence[str],
    fixed: Fixed,
    resolutions: tuple[Resolution | None, Resolution | None],
    model: Model | None = None,
) -> tuple[Simulators, Simulators]:
    """Simulators of colonies that are imaged as the data are.

    Arguments:
        targets: By condition.
        free: Names of the free parameters.
        fixed: Values of others.
        resolutions: Coarse and fine; None for that of `usual_resolution`.
        model: The rules; by default the source's.

    Returns:
        Coarse and fine ones, by condition.
    """
    nested = any(isinstance(one, Mapping) for one in fixed.values())
    held = _by_condition("fixed", fixed if nested else dict.fromkeys(targets, fixed), targets)
    coarse, fine = (
        {
            name: ColonySimulator.of(each, free, held[name], one or usual_resolution(each, one_is_coarse), model)
            for name, each in targets.items()
        }
        for one, one_is_coarse in zip(resolutions, (True, False), strict=True)
    )
    return {**coarse}, {**fine}


def colonies_in(coarse: Simulators, fine: Simulators) -> tuple[tuple[Resolution, Resolution] | None, Rules | None]:
    """Resolutions, coarse and fine, and rules of colonies, where these are not the source's.

    Resolutions are None where the simulators are of something else, or not alike in all conditions.
    """
    coarse, fine = ({name: inside(one) for name, one in each.items()} for each in (coarse, fine))
    colonies = [one for one in (*coarse.values(), *fine.values()) if isinstance(one, ColonySimulator)]
    resolutions = [{getattr(one, "resolution", None) for one in each.values()} for each in (coarse, fine)]
    rules = [one.curves.model.asdict() for one in colonies]
    mixed = len(colonies) < len(coarse) + len(fine) or any(one != rules[0] for one in rules)
    if mixed or any(len(each) > 1 or None in each for each in resolutions):
        return None, None
    both = resolutions[0].pop(), resolutions[1].pop()
    return both, None if rules[0] == Model().asdict() else rules[0]  # type: ignore[return-value]


def given_simulators(
    targets: Mapping[str, Targets],
    simulator: Simulator | Mapping[str, Simulator],
    fine: Simulator | Mapping[str, Simulator] | None,
) -> tuple[Simulators, Simulators]:
    """Simulators that were handed in, one for all conditions or by condition.

    Where no fine ones were, the same again: at the estimate itself they take out the shift of the mean by curvature, as
    ensembles lie around it.
    """
    given = _by_condition("simulator", simulator, targets)
    finer = given if fine is None else _by_condition("fine", fine, targets)
    for name, simulators in (("simulator", given), ("fine", finer)):
        for one in simulators.values():
            check_simulator(one, name)
    return given, finer


def common_parameters(simulators: Mapping[str, Simulator]) -> ParameterSet:
    """Free parameters of all conditions. Raise `InputError` where they differ."""
    first, *others = (one.parameters for one in simulators.values())
    for other in others:
        if other.names != first.names:
            raise InputError(
                f"simulator: conditions have the free parameters {', '.join(first)} and {', '.join(other)}, they need "
                "the same"
            )
    return first


def _by_condition(what: str, given: Any, targets: Mapping[str, Targets]) -> dict[str, Any]:
    """One for each condition."""
    if not isinstance(given, Mapping):
        return dict.fromkeys(targets, given)
    if set(given) != set(targets):
        raise InputError(
            f"{what} is for {', '.join(map(repr, given))}, the conditions are {', '.join(map(repr, targets))}"
        )
    return {name: given[name] for name in targets}
