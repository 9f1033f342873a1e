"""Parameters from mean curves by weighted least squares, with errors.

The means m(θ) of a stochastic simulator, with seeds that stay the same, are fitted to target means y in θ, the
logarithms of the free parameters of one condition or several (`parameter_space`):

    minimise χ²(θ) = (m(θ) − y)ᵀ Σ⁻¹ (m(θ) − y) + Σ_k (θ_k − μ_k)² / τ_k²,

the last term where there are Gaussian priors. m and its Jacobian J come from one ensemble, simulated in pairs around θ
(`paired_regression`); no simulation is differentiated. Σ holds the data's scatter, the ensemble's own Monte-Carlo error
and a measurement error (`ensemble`). The stages:

1. one simulation at each of some low-discrepancy points of the box; the best of them are the starts;
2. small ensembles, all starts in one batch, compared with a tolerance (`Ensembles.screening_covariance`); the best
   start goes on, and another one if it is about as good and ended elsewhere;
3. larger and larger ensembles, with Σ as it is at the stage's first point; in the last stage, what a fine simulator
   and the width of the pairs change is added to m. Each stage lets optimistix's solver step (`optimiser`) until another
   step promises to lower χ² by less than a tolerance;
4. where the data do not see a direction at the estimate, a second look: the best places elsewhere along it, by small
   ensembles, are starts of the same stages (`starting_points`), and the lowest χ² of all is the estimate.

The estimate is the minimum of one more affine function, that of the last stage's ensembles near its best point taken
together: θ̂ = θ + F⁻¹ g. cov θ̂ = F⁻¹, F the Fisher information, J's noise taken out; no error is given in a direction
that the data do not see (`information.result`).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.colony_simulator import DEFAULT_FREE
from yeastfit.inference.fit.ensemble import Ensembles
from yeastfit.inference.fit.result import Fit
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.fit.simulators import Fixed, colonies_in, colony_simulators, common_parameters, given_simulators
from yeastfit.inference.fit.stages import Fitter
from yeastfit.inference.parameter_space import ONLY, Bounds, ParameterSpace
from yeastfit.inference.resolution import Resolution
from yeastfit.inference.simulator import Simulator
from yeastfit.inference.targets import Targets
from yeastfit.kinds import check_kind
from yeastfit.model.model import Model
from yeastfit.numbers import Range, pair_of
from yeastfit.parameter_set import LARGEST, ParameterSet
from yeastfit.progress import Progress, progress_or_silent
from yeastfit.text import quoted

GaussianPriors = Mapping[str, tuple[float, float]]
"""By name: λ at the centre, and the standard deviation of log λ."""
WIDTHS = Range(1e-6, 1e3)  # of log λ; beyond, sums with the data lose one of the two


def fit(
    targets: Targets | Mapping[str, Targets],
    simulator: Simulator | Mapping[str, Simulator] | None = None,
    *,
    fine: Simulator | Mapping[str, Simulator] | None = None,
    free: Sequence[str] | None = None,
    own: Sequence[str] = (),
    fixed: Fixed | None = None,
    start: Mapping[str, float] | None = None,
    bounds: Bounds | None = None,
    prior: GaussianPriors | None = None,
    seed: int = 0,
    settings: FitSettings | None = None,
    model: Model | None = None,
    resolution: Resolution | None = None,
    fine_resolution: Resolution | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit the free parameters of a simulator to the targets. Same seed, same result.

    Arguments:
        targets: Data of one condition, or of several by name.
        simulator: Of what the data are of; one for each condition, or one for all. Its parameters are the free ones.
            By default colonies, imaged as the data were.
        fine: A more exact simulator that corrects the ensembles of the last stage; for colonies by default one of
            `fine_resolution`, for others the simulator itself, which corrects for curvature.
        free: Names of a colony's free parameters; by default mobility, metabolic rate and aspect ratio.
        own: Those of the free parameters that each condition has one of; the others are shared.
        fixed: Values of a colony's other parameters, by name, for all conditions or by condition; defaults else.
        start: Where to begin, by parameter or entry ("mobility of 50 µM"); defaults else. Without it, low-discrepancy
            points of the box.
        bounds: By parameter, instead of the plausible ranges.
        prior: By parameter or entry: its centre, and the standard deviation of its logarithm. With one the estimate is
            that of the largest posterior density.
        seed: Of all random numbers.
        settings: How to compute.
        model: Rules of the colonies; by default the source's.
        resolution: Of the colonies that ensembles are made of; by default Δt = 0.01 and a grid of 0.2 L0, coarser for
            large colonies (`usual_resolution`).
        fine_resolution: Of those that correct them.
        progress: Called with what is being done and the share that is done.

    Returns:
        A `Fit`, whose `status` says how it ended.

    Raises:
        InputError: Arguments that make no sense; parameters whose range reaches 0, where logarithms end.
        SimulationError: Simulations failed wherever the fit began.
    """
    settings = FitSettings() if settings is None else settings
    check_kind("settings", settings, FitSettings)
    progress = progress_or_silent(progress)
    several = {ONLY: targets} if isinstance(targets, Targets) else targets
    check_kind("targets", several, Mapping, "yeastfit.Targets, or several by the names of their conditions")
    by_name = dict(several)
    if not by_name:
        raise InputError("targets: there is no condition")
    for name, one in by_name.items():
        check_kind(f"targets: {quoted(name)}", one, Targets)
    if simulator is None and fine is not None:
        raise InputError("fine is given without simulator: give both, or fine_resolution for colonies")
    if simulator is None:
        chosen = DEFAULT_FREE if free is None else free
        simulators, finer = colony_simulators(by_name, chosen, fixed or {}, (resolution, fine_resolution), model)
    else:
        of_colonies = {"free": free, "fixed": fixed, "model": model, "resolution": resolution}
        _refuse_for_simulators(**of_colonies, fine_resolution=fine_resolution)
        simulators, finer = given_simulators(by_name, simulator, fine)
    parameters = common_parameters(simulators)
    space = ParameterSpace.of(parameters, tuple(by_name), own, bounds)
    begin = None if start is None else space.start(start, next(iter(simulators.values())).parameters)
    priors = _priors(prior or {}, space, parameters)
    _check_count(sum(len(each.values) for each in by_name.values()), space, priors)
    ensembles = Ensembles(by_name, simulators, space, seed, settings, finer if settings.refined else {})
    return Fitter(ensembles, priors, progress, colonies_in(simulators, finer)).run(begin)


def check_search(
    parameters: ParameterSet,
    conditions: Sequence[str],
    *,
    own: Sequence[str] = (),
    bounds: Bounds | None = None,
    prior: GaussianPriors | None = None,
    most: int | None = None,
) -> None:
    """Check what says where to search, before there are data.

    Arguments:
        parameters: The free ones.
        conditions: Their names.
        own: As in `fit`, as are `bounds` and `prior`.
        bounds: See there.
        prior: See there.
        most: Target values that the data can have, where that is known.

    Raises:
        InputError: Arguments that make no sense, or more parameters than the values could tell.
    """
    space = ParameterSpace.of(parameters, conditions, own, bounds)
    priors = _priors(prior or {}, space, parameters)
    if most is not None:
        _check_count(most, space, priors)


def _refuse_for_simulators(**given: Any) -> None:
    """Raise `InputError` where something is said of colonies beside a simulator."""
    for name, value in given.items():
        if value is not None:
            raise InputError(f"{name} is of colonies, the simulator that is given has its own: leave it out")


def _priors(prior: GaussianPriors, space: ParameterSpace, parameters: ParameterSet) -> dict[str, tuple[float, float]]:
    """Centre and width in θ of every entry that has one."""
    space.check_names("prior", prior)
    for name, pair in prior.items():
        centre, width = pair_of(pair, f"prior of {name}")
        if not (0 < centre <= LARGEST and width in WIDTHS):
            raise InputError(
                f"prior of {name} is {centre:g}, {width:g}: need λ above 0, of single precision, and as width of log λ "
                f"{WIDTHS}"
            )
        try:
            parameters[name.partition(" of ")[0]].check(centre)
        except InputError as error:
            raise InputError(f"prior of {name} is {centre:g}, {width:g}: {error}") from None
    found = {entry.name: prior.get(entry.name, prior.get(entry.parameter)) for entry in space.entries}
    return {name: (float(np.log(one[0])), float(one[1])) for name, one in found.items() if one is not None}


def _check_count(count: int, space: ParameterSpace, priors: Mapping[str, object]) -> None:
    """Raise `InputError` where there are too few data."""
    free = len(space.entries) - len(priors)
    if count <= free:
        held = f", of which a prior tells {len(priors)} more" if priors else ""
        raise InputError(
            f"{count} target values (statistics × times) cannot determine {free} free parameters{held}: take more "
            "statistics or times, hold parameters at values, or give them a prior"
        )
