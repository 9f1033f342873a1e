"""Several runs beside each other: those on the same data as models, those under one model as conditions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import isclose, isfinite
from typing import Any

from yeastfit.errors import InputError
from yeastfit.inference.comparison.conditions import ConditionComparison
from yeastfit.inference.comparison.left_out import LeftOut
from yeastfit.inference.comparison.models import ModelComparison, difference_of_data
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.prior.distributions import Distribution
from yeastfit.text import quoted

ROUNDING = 1e-12  # relative difference of means over the same colonies in another order


@dataclass(frozen=True)
class ComparedRun:
    """A finished run of `infer`.

    Attributes:
        name: That it is called by.
        model: Name of its model.
        data: Condition, and the SHA-256 of the data's files.
        settings: Of model and data: statistics, held parameters, and the like.
        posterior: Its draws.
        left_out: Its predictions of colonies left out, where it has made some.
        colonies: What was observed of each, by name; those left out where they are not given.
    """

    name: str
    model: str
    data: tuple[str, ...]
    settings: Mapping[str, Any]
    posterior: Posterior
    left_out: LeftOut | None = None
    colonies: tuple[Mapping[str, float], ...] = ()

    def observed(self) -> list[dict[str, float]]:
        """What is known of each colony."""
        given: Sequence[Mapping[str, float]] = self.colonies
        if not given and self.left_out is not None:
            given = [dict(zip(self.left_out.labels, row, strict=True)) for row in self.left_out.observed.tolist()]
        return [{name: value for name, value in one.items() if isfinite(value)} for one in given]


@dataclass(frozen=True)
class Comparison:
    """What several runs tell beside each other.

    Attributes:
        runs: All of them.
        models: One for each set of data that several runs are of.
        conditions: One for each pair of runs under the same model on other data.
        doubts: What is to be doubted, in words.
    """

    runs: tuple[ComparedRun, ...]
    models: tuple[ModelComparison, ...]
    conditions: tuple[ConditionComparison, ...]
    doubts: tuple[str, ...]

    @staticmethod
    def of(runs: Sequence[ComparedRun]) -> "Comparison":
        """Compare all that can be.

        Raises:
            InputError: There are fewer than two runs, two of one name, or nothing to compare.
        """
        runs, names = _told_apart(runs), [one.name for one in runs]
        if len(runs) < 2:
            raise InputError(f"runs: got {', '.join(names) or 'none'}, need at least two to compare")
        if twice := [name for name in names if names.count(name) > 1]:
            raise InputError(f"runs: {twice[0]} is given twice, need each once")
        doubts = [f"{one.name}: {one.posterior.status}" for one in runs if not one.posterior.settled]
        models, why = _models(runs)
        conditions, others = _conditions(runs)
        if not (models or conditions):
            reasons = "; ".join([*why, *others]) or "runs are of other models and other data"
            raise InputError(f"runs: nothing to compare: {reasons}")
        compared = {one.name: one.left_out.doubts for each in models for one in each.runs}
        of_runs = [f"{name}: {doubt}" for name, each in compared.items() for doubt in each]
        doubts += [*why, *others, *of_runs]
        return Comparison(tuple(runs), models, conditions, tuple(dict.fromkeys(doubts)))

    @property
    def settled(self) -> bool:
        """Whether every posterior is."""
        return all(one.posterior.settled for one in self.runs)

    def sentences(self) -> list[str]:
        """All verdicts."""
        of_models = [sentence for each in self.models for sentence in each.sentences()]
        return of_models + [sentence for each in self.conditions for sentence in each.sentences()]


def _told_apart(runs: Sequence[ComparedRun]) -> list[ComparedRun]:
    """Runs with one name of the data for all that have seen the same numbers, as photographs or as a table of them."""
    found = list[ComparedRun]()
    for one in runs:
        first = next((other for other in found if _same_numbers(one.posterior, other.posterior)), one)
        found.append(replace(one, data=first.data))
    return found


def _same_numbers(one: Posterior, other: Posterior) -> bool:
    """Whether all statistics that both have seen are the same, and not all of them counts."""
    return _alike(*(dict(zip(each.labels, each.observed.tolist(), strict=True)) for each in (one, other)))


def _alike(one: Mapping[str, float], other: Mapping[str, float]) -> bool:
    """Whether all numbers that both have are the same, and not all of them counts."""
    names = [name for name in one if name in other]
    same = all(isclose(one[name], other[name], rel_tol=ROUNDING) for name in names)
    return same and not all(float(one[name]).is_integer() for name in names)


def _models(runs: Sequence[ComparedRun]) -> tuple[tuple[ModelComparison, ...], list[str]]:
    """Of each set of data, and why some of its runs are left out."""
    found, doubts = [], list[str]()
    for data in dict.fromkeys(one.data for one in runs):
        same = [one for one in runs if one.data == data]
        if len(same) < 2:
            continue
        scored = {one.name: one.left_out.in_order() for one in same if one.left_out is not None}
        bare = [one.name for one in same if one.left_out is None]
        doubts += [
            f"{name} has left no colonies out: models are compared by those, run infer with --leave-out"
            for name in bare
        ]
        alike: dict[str, LeftOut] = {}
        for name, left_out in scored.items():
            first = next(iter(alike), None)
            why = "" if first is None else difference_of_data(alike[first], left_out)
            if why:
                doubts.append(f"{first} and {name} are of the same data, but not compared: {why}")
            else:
                alike[name] = left_out
                if first is not None and left_out.groups != alike[first].groups:
                    doubts.append(
                        f"colonies were left out in {alike[first].groups} groups in {first} and in {left_out.groups} "
                        f"in {name}, and predicted from other numbers of colonies: densities may differ by that alone"
                    )
        if len(alike) > 1:
            found.append(ModelComparison.of(alike))
    return tuple(found), doubts


def _conditions(runs: Sequence[ComparedRun]) -> tuple[tuple[ConditionComparison, ...], list[str]]:
    """Of each pair of runs under one model on other data, and what else differs between them."""
    found, doubts = [], list[str]()
    for one, other in combinations(runs, 2):
        if one.model != other.model or one.data == other.data:
            continue
        if not set(one.posterior.free) & set(other.posterior.free):
            doubts.append(f"{one.name} and {other.name} are not compared: no parameter is free in both")
            continue
        found.append(ConditionComparison.of(one.name, one.posterior, other.name, other.posterior))
        if shared := _shared(one.observed(), other.observed()):
            noun = "colony" if shared == 1 else "colonies"
            doubts.append(
                f"{one.name} and {other.name} have {shared} {noun} in common, and are compared as if all were others"
            )
        doubts += [
            f"{name} is {_said(one.settings.get(name))} in {one.name} and {_said(other.settings.get(name))} in "
            f"{other.name}: "
            "parameters may differ by that alone"
            for name in sorted({*one.settings, *other.settings})
            if one.settings.get(name) != other.settings.get(name)
        ]
        priors = one.posterior.prior.distributions, other.posterior.prior.distributions
        doubts += [
            f"the prior of {name} is {_words(priors[0][name])} in {one.name} and {_words(priors[1][name])} in "
            f"{other.name}: posteriors may differ by that alone"
            for name in priors[0]
            if name in priors[1] and priors[0][name] != priors[1][name]
        ]
    return tuple(found), doubts


def _shared(colonies: Sequence[Mapping[str, float]], others: Sequence[Mapping[str, float]]) -> int:
    """How many colonies have the same numbers in both, as far as they are known."""
    return sum(any(_alike(one, other) for other in others) for one in colonies)


def _said(setting: Any) -> str:
    """A setting, as files write it."""
    return "not given" if setting is None else quoted(setting)


def _words(distribution: Distribution) -> str:
    """A distribution and its numbers."""
    numbers = ", ".join(f"{name} {value:g}" for name, value in distribution.numbers.items())
    return f"{distribution.family} ({numbers})"
