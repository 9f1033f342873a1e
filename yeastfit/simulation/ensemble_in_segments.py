"""An ensemble whose members grow in segments, each in arrays of its own, and may be kept while they do."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jaxtyping import Array, PyTree

from yeastfit.model.colony import Colony
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Observe
from yeastfit.simulation.kept_colonies import KeptColony, signature_of
from yeastfit.simulation.large_ensemble import member_of, on_all_devices, stacked, together
from yeastfit.simulation.segments import Segments
from yeastfit.simulation.until import Until


def grown_in_segments(
    parameters: Parameters,
    began: Array | Colony,
    samples: Sequence[int],
    relaxation: Relaxation,
    numerics: Numerics,
    first_numerics: Numerics,
    observe: Observe,
    model: Model,
    until: Until | None = None,
    keep: str | Path | None = None,
) -> tuple[Colony, PyTree]:
    """Grow each member on its own, by `Segments`; arguments are those of `simulate` and `Segments`.

    Arguments:
        parameters: With one value per member.
        began: Keys or colonies.
        samples: Steps to observe.
        relaxation: Smoothing widths.
        numerics: Grid, time step and the most nodes.
        first_numerics: With the room of a colony that begins.
        observe: What to record.
        model: The rules.
        until: What ends growth before the last sample.
        keep: Folder of colonies as they grow.

    Returns:
        The last states and what was observed, of all members.
    """
    rules = relaxation, numerics, observe, model
    passed = None if until is None else until.passed

    def grown(member: int) -> tuple[Colony, PyTree]:
        how = Segments(member_of(parameters, member), *rules)
        first = member_of(began, member)
        colony = first if isinstance(first, Colony) else model.start(first, first_numerics)
        if keep is None:
            colony, observed = how.grown(colony, samples, passed)
        else:
            signature = signature_of(how.parameters, first, list(samples), *rules, str(until))
            kept = KeptColony(_file(keep, member), signature)
            colony, before = kept.found(colony, how.shapes)
            colony, observed = how.grown(colony, samples, passed, before, kept)
        return colony, stacked(observed)

    members = parameters.diffusivity.shape[0]
    colonies, observed = zip(*on_all_devices(grown, members), strict=True)
    for member in range(members if keep is not None else 0):
        _file(keep, member).unlink(missing_ok=True)
    return together(list(colonies), model), stacked(list(observed))


def _file(keep: Any, member: int) -> Path:
    return Path(keep) / f"colony_{member}.npz"
