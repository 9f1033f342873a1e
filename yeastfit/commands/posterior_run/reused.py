"""Simulations that a run takes over from an earlier one: `yeastfit infer --reuse FOLDER`.

They are copied once, to reused.h5. A posterior depends on them, so that run.json keeps their SHA-256: with other ones
the run does not go on.
"""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from yeastfit.commands.posterior_run.config import Request
from yeastfit.commands.run_folder import RunFolder, differences, other_versions, read_run
from yeastfit.errors import InputError
from yeastfit.inference.posterior.sampler import Sampler
from yeastfit.inference.store.simulation_store import Store
from yeastfit.results.contents import MANIFEST, RUN, check_finished
from yeastfit.results.folder import check_at_rest
from yeastfit.storage import as_json, from_json, written_whole

SIMULATIONS, REUSED = "simulations.h5", "reused.h5"


def check_reusable(reuse: Path, request: Request) -> None:
    """Check that a folder holds simulations of these parameters by this model.

    The run need not have finished: of one that was killed those simulations count whose checksums are right.

    Raises:
        InputError: There is no earlier run, or its simulations are others.
    """
    if not (reuse / SIMULATIONS).is_file():
        raise InputError(f"--reuse: {reuse} holds no {SIMULATIONS}, need the folder of a run of infer")
    if (reuse / MANIFEST).is_file():
        check_finished(reuse)
    elif not (reuse / RUN).is_file():
        raise InputError(f"--reuse: {reuse} has neither {MANIFEST} nor {RUN}, need the folder of a run of infer")
    check_at_rest(reuse)
    if not (reuse / RUN).is_file():
        return
    earlier = read_run(reuse / RUN)["configuration"]
    names = ("model", "free", "fixed", *request.forward_model.settings("infer"))
    now = from_json(as_json(request.configuration()))
    was, now = ({name: one.get(name) for name in names} for one in (earlier, now))
    if other := differences(was, now):
        raise InputError(f"--reuse: {reuse} holds other simulations: {'; '.join(other)}")


def take_over(reuse: Path | None, folder: RunFolder, sampler: Sampler, store: Callable[[Path], Store]) -> list[str]:
    """Copy simulations of an earlier run, once, and see that the copy stays what it was.

    Arguments:
        reuse: The folder of the earlier run.
        folder: Of this one.
        sampler: Of this one.
        store: Opens a file of simulations of this run's kind.

    Returns:
        In what these simulations differ from what this run would make, in words.

    Raises:
        InputError: They are of another kind, or not those with which the run began.
    """
    copy, doubts = folder.path / REUSED, list[str]()
    if not copy.is_file():
        if reuse is None:
            return []
        doubts = _copied(reuse, copy, folder, sampler, store)
    with store(copy) as simulations:
        now = {"sha256": simulations.sha256, "doubts": doubts}
    began = folder.remembered("reused", now)
    if began["sha256"] != now["sha256"]:
        raise InputError(
            f"--resume: {copy} holds other simulations than when the run began: put the file back, or begin anew in "
            "another folder"
        )
    return list(began["doubts"])


def _copied(reuse: Path, copy: Path, folder: RunFolder, sampler: Sampler, store: Callable[[Path], Store]) -> list[str]:
    """Copy them; what `take_over` returns."""
    with written_whole(copy) as temporary:
        shutil.copyfile(reuse / SIMULATIONS, temporary)
        try:
            with store(temporary) as simulations:
                torn = [one.replace(temporary.name, f"--reuse: {reuse / SIMULATIONS}") for one in simulations.notes]
        except InputError as error:
            told = str(error).replace(str(temporary), str(reuse / SIMULATIONS))
            raise InputError(f"--reuse: {told}") from None
    folder.notes.extend(torn)
    if not (reuse / RUN).is_file():
        return []
    earlier = read_run(reuse / RUN)
    if not getattr(sampler, "learns", False):
        folder.notes.extend(_of_no_use(reuse, earlier, {**folder.configuration, "seed": folder.seed}))
    other = other_versions(earlier)
    return [f"simulations of {reuse} are not to the last bit what they would be now, as {other}"] if other else []


def _of_no_use(reuse: Path, earlier: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """In words, why a method that repeats simulations, but does not learn from others, finds none of its own.

    Arguments:
        reuse: The folder of the earlier run.
        earlier: What it was, with seed and configuration.
        now: Configuration and seed of this run.
    """
    before = {**earlier["configuration"], "seed": earlier["seed"]}
    different = [name for name in ("seed", "prior") if before.get(name) != now[name]]
    count, counts = now["settings"].get("replicates", 1), before["settings"].get("replicates", 1)
    different += ["replicates"] if count != counts else []
    if not different:
        return []
    return [
        f"--reuse: nothing in {reuse} will be of use, it has other {', '.join(different)} than this run: "
        f"{now['method']} takes what it would make itself"
    ]
