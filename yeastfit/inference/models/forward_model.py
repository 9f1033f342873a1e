"""What commands need to know of a forward model: the base class of the entries of `FORWARD_MODELS`.

A model is a frozen dataclass. Its fields are its settings, each an option of the commands; what is said of an option
stands in its annotation, `Annotated[int, Setting("Number of cells.")]`. Parameters, and rules that bring some, become
options too.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, get_type_hints

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.models.grown import Grown, Outlines
from yeastfit.inference.models.image_checks import check_comparable
from yeastfit.inference.posterior.limits import Limits, limits_around
from yeastfit.inference.posterior.settings import Setting
from yeastfit.inference.prior.prior import Bounded, Prior
from yeastfit.inference.sensitivity.result import Sensitivity
from yeastfit.inference.simulator import Simulator
from yeastfit.inference.targets import Targets
from yeastfit.inference.targets_from_table import targets_in_hours
from yeastfit.measure.measurements_table import OF_ANYTHING
from yeastfit.measure.statistics.registry import STATISTICS, known_statistics
from yeastfit.model.model import Model
from yeastfit.panel import Panel
from yeastfit.parameter_set import ParameterSet
from yeastfit.text import listed

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Seen:
    """Data of one condition as a model sees them.

    Attributes:
        model: The model, with what it takes from the data in the place of settings that were left open.
        targets: The curves that are compared.
        notes: What a user should know about them, in words.
    """

    model: "ForwardModel"
    targets: Targets
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class ForwardModel(ABC):
    """A forward model of measured colonies, or of anything else, with its settings.

    `free`, `parameters` and `simulator` are enough for `fit` and `infer`, and `statistics` where it has no compactness
    and radius; `design` asks for `sensitivity`, `simulate` for `grow`.

    Attributes:
        free: Names of the parameters that `infer` infers by default.
        fitted: Those that `fit` fits and `design` plans for by default.
        statistics: What is compared by default.
        designed: What `design` chooses from by default.
        of_li: What `infer --li` compares by default; what `design` chooses from where it is empty.
        nouns: What one replicate is called, and several.
        columns: What a table of its data must have besides the statistics.
        units: A sentence for pages on the units of parameters and statistics.
    """

    free: ClassVar[tuple[str, ...]]
    fitted: ClassVar[tuple[str, ...]] = ()
    statistics: ClassVar[tuple[str, ...]] = ("compactness", "radius")
    designed: ClassVar[tuple[str, ...]] = ("compactness", "radius", "area")
    of_li: ClassVar[tuple[str, ...]] = ()
    nouns: ClassVar[tuple[str, str]] = ("simulation", "simulations")
    columns: ClassVar[tuple[str, ...]] = OF_ANYTHING
    units: ClassVar[str] = ""

    @property
    def timed(self) -> bool:
        """Whether colonies are compared at their age; of those that are not the last image alone is compared."""
        return True

    @property
    @abstractmethod
    def parameters(self) -> ParameterSet:
        """All parameters, those that its rules bring included."""

    @abstractmethod
    def simulator(self, targets: Targets, free: Sequence[str], fixed: Mapping[str, float]) -> Simulator:
        """A simulator of the data of one condition.

        Arguments:
            targets: The data; the columns of the simulator are in the order of `Targets.values`.
            free: Names of the free parameters.
            fixed: Values of all others.

        Returns:
            A simulator of one replicate a row.
        """

    def acting(self, statistics: Sequence[str]) -> ParameterSet:
        """Parameters that decide over these statistics; all of them by default."""
        return self.parameters

    def held(self, statistics: Sequence[str], free: Sequence[str], given: Mapping[str, float]) -> dict[str, float]:
        """Values of parameters that act and are not free, and of all others that are given.

        Arguments:
            statistics: That are compared.
            free: Names of parameters.
            given: Values by name; the others have their defaults.

        Returns:
            Values by name.
        """
        values = {**self.acting(statistics).defaults, **given}
        return {name: value for name, value in values.items() if name not in free}

    def limits(self, targets: Targets) -> Limits | None:
        """Beyond which a colony is none of the data's kind, for posteriors: those around colonies of one time.

        Models have some that are far from all others: of a disc with a hole in the middle an I_R of 1 to 20, where
        photographs have 0.2. Curves over time have no limits.
        """
        if targets.curves is None or len(targets.times) > 1:
            return None
        return limits_around(targets.curves[:, targets.measured])

    def fit_simulators(
        self, targets: Targets, free: Sequence[str], fixed: Mapping[str, float]
    ) -> tuple[Simulator, Simulator]:
        """The simulator of a fit, and a finer one that corrects it.

        Arguments:
            targets: As of `simulator`, like the others.
            free: Likewise.
            fixed: Likewise.

        Returns:
            Both; by default twice the same.
        """
        simulator = self.simulator(targets, free, fixed)
        return simulator, simulator

    def statistics_named(self, names: Sequence[str]) -> tuple[str, ...]:
        """Names of statistics as `Targets` has them.

        Raises:
            InputError: One is unknown, or appears twice, which would double its weight.
        """
        known = {*known_statistics("smooth"), *known_statistics("mask")}
        known |= {name for name, one in STATISTICS.items() if not one.forms}
        for name in names:
            check_comparable(name)
            if name not in known:
                raise InputError(f"--statistics: {name!r} is unknown, expected some of {listed(sorted(known))}")
            if names.count(name) > 1:
                raise InputError(f"--statistics: {name!r} appears twice, expected each once")
        return tuple(names)

    def seen(self, rows: Sequence[Row], folder: Path, condition: str | None, statistics: Sequence[str]) -> Seen:
        """Data of one condition from a table of measurements: by default as they stand there, over hours and in µm.

        Arguments:
            rows: Of measurements.csv.
            folder: Where it lies, and masks with it.
            condition: Which; may be left out where there is one.
            statistics: Which curves.

        Returns:
            The data, the model that goes with them, and notes for the user.
        """
        return Seen(self, targets_in_hours(rows, condition=condition, statistics=statistics))

    def measurement_errors(self, names: Sequence[str], given: float | None) -> dict[str, float]:
        """Relative error of measurement of each statistic, of a fit, a posterior or a design.

        Arguments:
            names: Of the statistics.
            given: One number for all; by default each has its own.

        Returns:
            Errors by statistic.
        """
        errors = {name: STATISTICS[name].measurement_error if name in STATISTICS else 0.0 for name in names}
        return errors if given is None else dict.fromkeys(names, given)

    def colony_errors(self, names: Sequence[str], given: float | None) -> dict[str, float]:
        """Relative error of measurement that every colony has for itself, by default none.

        Arguments:
            names: Of the statistics.
            given: What a user says of the errors of means; colonies have none of their own then.

        Returns:
            Errors by statistic.
        """
        return dict.fromkeys(names, 0.0)

    def prior(self, parameters: ParameterSet, *, bounded: Bounded = "log-uniform") -> Prior:
        """The prior where a user gives none.

        Arguments:
            parameters: The free ones.
            bounded: As `Prior.default` has it.

        Returns:
            A prior of these parameters.
        """
        return Prior.default(parameters, bounded=bounded)

    def check(self, largest: Mapping[str, float], hours: Sequence[float]) -> None:  # noqa: B027 - most compute anything
        """Check that the settings can compute what is asked for, before anything is measured; by default anything.

        Arguments:
            largest: Parameters, those that are free as large as they may become.
            hours: At which there are images, rising.

        Raises:
            InputError: They cannot.
        """

    def check_images(self, images: Sequence[Row], statistics: Sequence[str]) -> None:  # noqa: B027 - likewise
        """Check that images of one condition can be compared, before any is measured; by default any can.

        Arguments:
            images: Rows of file, replicate, hours and, where it is known, um_per_pixel.
            statistics: Which are compared.

        Raises:
            InputError: They cannot.
        """

    def unit_of(self, name: str) -> tuple[float, str]:
        """What a parameter is multiplied by to have units, and the unit; 1 and "" where it has none."""
        return 1.0, self.parameters[name].unit

    def outlines(
        self, simulator: Any, values: Float[np.ndarray, "row free"], targets: Targets, seed: int
    ) -> Outlines | None:
        """Masks of what is simulated at the data's last time.

        Arguments:
            simulator: Made by `simulator`.
            values: Its free parameters, one colony a row.
            targets: The data.
            seed: Of the colonies.

        Returns:
            Masks and µm per pixel; None where there is nothing to draw.
        """
        return None

    def sensitivity(self, statistics: Sequence[str], values: Mapping[str, float], **how: Any) -> Sensitivity:
        """Derivatives of the means of statistics at given values, for `design`.

        Arguments:
            statistics: Names.
            values: Of parameters, as far as they are given.
            **how: `runs`, `seed`, `progress` and, where workers simulate, `elsewhere`: see `yeastfit.sensitivity`.

        Returns:
            As `yeastfit.sensitivity` does.

        Raises:
            InputError: The model has no such thing.
        """
        raise InputError(f"--model: {type(self).__name__} has no sensitivity without data, which design needs")

    def grow(self, values: Mapping[str, float], members: int, seed: int, statistics: Sequence[str] = ()) -> Grown:
        """Colonies at given values of all parameters, for `simulate`.

        Arguments:
            values: Of parameters, as far as they are given.
            members: How many colonies.
            seed: Of their random numbers.
            statistics: Names of those to record; by default the model's own choice.

        Returns:
            The colonies, as `simulate` writes and draws them.

        Raises:
            InputError: The model has no such thing.
        """
        raise InputError(f"--model: {type(self).__name__} has no `grow`, which simulate needs: use fit or infer")

    def keeping(self, folder: Path) -> "ForwardModel":
        """The same model, whose `grow` keeps in a folder what it goes on from when it is broken off, if it can."""
        return self

    def ended_as(self, grown: Grown) -> "ForwardModel":
        """The same model, whose movie ends where the first of these colonies of `grow` did, if it could be later."""
        return self

    def movie(self, values: Mapping[str, float], seed: int, frames: int) -> Iterator[list[Panel]]:
        """What the first colony of `grow` looks like at so many moments from its beginning to its end.

        Arguments:
            values: Of parameters, as far as they are given.
            seed: As of `grow`.
            frames: How many moments.

        Yields:
            Panels of each moment.

        Raises:
            InputError: The model has no such thing.
        """
        raise InputError(f"--model: {type(self).__name__} has no `movie`, which simulate --movie needs: leave it out")

    def settings(self, command: str) -> dict[str, Any]:
        """The settings that a command has, plain data; rules are named where they are not the default ones."""
        found = dict[str, Any]()
        for name in settings_of(type(self), command):
            value = getattr(self, name)
            if not isinstance(value, Model):
                found[name] = value
            elif value.asdict() != Model().asdict():
                found[name] = value.asdict()
        return found


def settings_of(model: type[ForwardModel], command: str) -> dict[str, Setting]:
    """What is said of the settings of a model that a command has, by name."""
    hints = get_type_hints(model, include_extras=True)
    found = {}
    for each in fields(model):
        said = (data for data in getattr(hints[each.name], "__metadata__", ()) if isinstance(data, Setting))
        setting = next(said, Setting(""))
        if not setting.commands or command in setting.commands:
            found[each.name] = setting
    return found
