"""λ from target curves by weighted least squares, with errors.

The mean curves m(θ) of hard colonies, with keys that stay the same, are fitted to target means y in θ, the entries of
log λ that are free in one condition or several (`parameter_space`):

    minimise χ²(θ) = (m(θ) − y)ᵀ Σ⁻¹ (m(θ) − y) + Σ_k (θ_k − μ_k)² / τ_k²,

the last term where there are Gaussian priors. m and its Jacobian J come from one ensemble, grown in pairs around θ
(`paired_regression`); no colony is differentiated. Σ holds the data's scatter, the ensemble's own Monte-Carlo error and
a measurement error (`ensemble`). The stages:

1. one colony at each of some low-discrepancy points of the box; the best of them are the starts;
2. small ensembles, all starts in one batch, the comparison blunted (`Ensembles.rough`); the best start goes on, and
   another one if it is about as good and ended elsewhere;
3. larger and larger ensembles, with Σ as it is at the stage's first point; in the last stage, what finer numerics and
   the width of the pairs change is added to m. Each stage lets optimistix's solver step (`optimiser`) until another
   step promises to lower χ² by less than a tolerance.

The estimate is the minimum of one more affine function, that of the last stage's ensembles near its best point taken
together: θ̂ = θ + F⁻¹ g. cov θ̂ = F⁻¹, F the Fisher information, J's noise taken out; no error is given in a direction
that the data do not see (`information.result`).
"""

from collections.abc import Mapping, Sequence

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.fit.ensemble import Ensembles
from yeastfit.inference.fit.result import Fit
from yeastfit.inference.fit.settings import FitSettings
from yeastfit.inference.fit.stages import Fitter
from yeastfit.inference.parameter_space import ALONE, Bounds, Space
from yeastfit.inference.targets import Targets
from yeastfit.model.parameters import Parameters
from yeastfit.progress import Progress, silent

Prior = Mapping[str, tuple[float, float]]
"""By name: λ at the centre, and the standard deviation of log λ."""

DEFAULT_FREE = ("mobility", "metabolic_rate", "aspect_ratio")


def fit(
    targets: Targets | Mapping[str, Targets],
    *,
    free: Sequence[str] = DEFAULT_FREE,
    own: Sequence[str] = (),
    fixed: Parameters | Mapping[str, Parameters] | None = None,
    start: Parameters | Mapping[str, Parameters] | None = None,
    bounds: Bounds | None = None,
    prior: Prior | None = None,
    seed: int = 0,
    settings: FitSettings | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit the free parameters to the targets, the others held at `fixed` (default: the source's values).

    targets: of one condition, or of several by name; then free parameters are shared by all but for those in `own`, of
    which each condition has one. fixed and start likewise, one for all or by condition. start: where to begin; without
    it, low-discrepancy points of the box. bounds: of λ by parameter, instead of the plausible ranges. prior: by
    parameter or entry ("mobility", "mobility of 50 µM"), its centre and the standard deviation of log λ; with one the
    estimate is that of the largest posterior density.

    Same seed, same result. Returns a `Fit`, whose `status` says in words how it ended. Raises `InputError`.
    """
    by_name = {ALONE: targets} if isinstance(targets, Targets) else dict(targets)
    held = _by_condition("fixed", fixed or Parameters(), by_name)
    space = Space.of(free, held, own, bounds)
    begin = None if start is None else space.theta(_by_condition("start", start, by_name))
    pulls = _priors(prior or {}, space)
    _check(by_name, space, pulls)
    ensembles = Ensembles.of(by_name, space, seed, settings or FitSettings())
    return Fitter(ensembles, pulls, progress or silent).run(begin)


def _by_condition(
    what: str, given: Parameters | Mapping[str, Parameters], targets: Mapping[str, Targets]
) -> dict[str, Parameters]:
    """One for each condition."""
    if isinstance(given, Parameters):
        return dict.fromkeys(targets, given)
    if set(given) != set(targets):
        raise InputError(
            f"{what} is for {', '.join(map(repr, given))}, the conditions are {', '.join(map(repr, targets))}"
        )
    return {name: given[name] for name in targets}


def _priors(prior: Prior, space: Space) -> dict[str, tuple[float, float]]:
    """Centre and width in θ of every entry that has one."""
    names = {entry.parameter for entry in space.entries}
    for name, (centre, width) in prior.items():
        if name not in names | set(space.names):
            raise InputError(f"prior names {name!r}, which is not free: {', '.join(space.names)} are")
        if not (np.isfinite([centre, width]).all() and centre > 0 and width > 0):
            raise InputError(f"prior of {name} is {centre:g}, {width:g}: need λ above 0 and a width of log λ above 0")
    found = {entry.name: prior.get(entry.name, prior.get(entry.parameter)) for entry in space.entries}
    return {name: (float(np.log(one[0])), float(one[1])) for name, one in found.items() if one is not None}


def _check(targets: Mapping[str, Targets], space: Space, pulls: Mapping[str, tuple[float, float]]) -> None:
    if not targets:
        raise InputError("targets: there is no condition")
    count, free = sum(len(each.values) for each in targets.values()), len(space.entries) - len(pulls)
    if count <= free:
        raise InputError(f"{count} target values cannot determine {free} free parameters: measure more, or fix some")
