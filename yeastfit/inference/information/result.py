"""The Fisher information of log λ that `information` returns: its directions, and what the data do not determine.

F = A + diag(1 / τ²), A the data's part, tr(W N_i W N_j) the noise of J in it (`fisher`). Along a unit direction v,
noise alone gives vᵀAv the variance 2 Σ_ij v_i² v_j² tr(W N_i W N_j).

**Blind directions.** An eigenvalue of A counts as significant above `SIGNIFICANT` standard deviations of its noise;
otherwise it is set to 0. Of the F that is left, a direction is blind where the error of log λ along it, 1/√eigenvalue,
is above a limit, by default 1: a factor e. A parameter with a component above `LOADING` in the blind directions, unit
vectors, has no standard error. Errors of the others include what the blind directions add to them, except directions
of eigenvalue 0, which are taken for fixed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.inference.curve_covariance import ROUNDING
from yeastfit.inference.information.identifiability import LOADING, blind_sentence, combination, percent, sparse_basis
from yeastfit.storage import read_json, reads_saved, write_json

SIGNIFICANT = 2.0  # standard deviations of what the noise of J alone makes of an eigenvalue: 95 % of noise is below

FreeSquare = Float[np.ndarray, "free free"]


class InformationStatus(StrEnum):
    """Whether data determine what is asked of them; the values are messages."""

    DETERMINED = "the data determine all free parameters"
    PARTLY_BLIND = "the data leave combinations of the free parameters undetermined"


@dataclass(frozen=True, eq=False)
class Information:
    """Fisher information of log λ of the free parameters.

    Attributes:
        free: Their names.
        data: A, which may have negative eigenvalues where it is all noise.
        noise: tr(W N_i W N_j).
        prior: Standard deviations of log λ, by name.
        limit: Error of log λ beyond which a direction is blind.
    """

    free: tuple[str, ...]
    data: FreeSquare
    noise: FreeSquare
    prior: dict[str, float]
    limit: float = 1.0

    @cached_property
    def significant(self) -> tuple[Float[np.ndarray, " direction"], Float[np.ndarray, "direction free"]]:
        """Significant eigenvalues of the data's part, and their eigenvectors."""
        values, vectors = np.linalg.eigh(self.data)
        seen = values > np.maximum(self._floor(vectors.T), ROUNDING * np.abs(values).max())
        return values[seen], vectors.T[seen]

    @cached_property
    def matrix(self) -> FreeSquare:
        """F without the directions in which the data's part is not significant."""
        values, rows = self.significant
        return (rows.T * values) @ rows + np.diag(precision(self.prior, self.free))

    @cached_property
    def _spectrum(self) -> tuple[np.ndarray, np.ndarray]:
        values, vectors = np.linalg.eigh(self.matrix)
        values = np.where(values > ROUNDING * np.abs(values).max(), values, 0.0)[::-1]
        rows = vectors.T[::-1]
        largest = np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], axis=1)
        return values, rows * np.where(largest < 0, -1.0, 1.0)

    @property
    def eigenvalues(self) -> Float[np.ndarray, " direction"]:
        """Of `matrix`, largest first; 0 where nothing is known."""
        return self._spectrum[0]

    @property
    def directions(self) -> Float[np.ndarray, "direction free"]:
        """Unit vectors in log λ that belong to `eigenvalues`, largest component positive."""
        return self._spectrum[1]

    @cached_property
    def noise_floor(self) -> Float[np.ndarray, " direction"]:
        """What the data's part of each eigenvalue must exceed to be significant."""
        return self._floor(self.directions)

    @cached_property
    def direction_errors(self) -> Float[np.ndarray, " direction"]:
        """Error of log λ along each of `directions`; inf where nothing is known."""
        with np.errstate(divide="ignore"):
            return 1.0 / np.sqrt(self.eigenvalues)

    @cached_property
    def blind(self) -> np.ndarray:
        """Which of `directions` have an error above `limit`."""
        return self.direction_errors > self.limit

    @cached_property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters that have a share in the blind directions."""
        share = np.sqrt((self.directions[self.blind] ** 2).sum(axis=0))
        return tuple(name for name, one in zip(self.free, share, strict=True) if one > LOADING)

    @property
    def status(self) -> InformationStatus:
        """Whether any direction is blind; `sentences` says which."""
        return InformationStatus.PARTLY_BLIND if self.blind.any() else InformationStatus.DETERMINED

    @property
    def has_pairs(self) -> bool:
        """Whether two parameters or more are determined, so that pairs of them can be drawn."""
        return len(self.free) - len(self.undetermined) > 1

    @cached_property
    def log_covariance(self) -> FreeSquare:
        """Covariance of log λ; nan for parameters that are `undetermined`."""
        known = self.eigenvalues > 0
        rows = self.directions[known]
        found = (rows.T / self.eigenvalues[known]) @ rows
        hidden = np.isin(self.free, self.undetermined)
        found[hidden | hidden[:, None]] = np.nan
        return found

    @property
    def log_standard_errors(self) -> dict[str, float]:
        """Of log λ, relative errors where they are small; nan for parameters that are `undetermined`."""
        return dict(zip(self.free, np.sqrt(np.diag(self.log_covariance)).tolist(), strict=True))

    def without(self, name: str) -> "Information":
        """With one parameter fixed."""
        kept = [k for k, one in enumerate(self.free) if one != name]
        square = np.ix_(kept, kept)
        free = tuple(self.free[k] for k in kept)
        prior = {one: width for one, width in self.prior.items() if one != name}
        return replace(self, free=free, data=self.data[square], noise=self.noise[square], prior=prior)

    @cached_property
    def best_fixed(self) -> str | None:
        """The parameter that, fixed, leaves fewest blind directions and then the least variance of log λ in the others.

        None where no direction is blind, or nothing would be left.
        """
        if not self.blind.any() or len(self.free) < 2:
            return None

        def left(name: str) -> tuple[int, float]:
            rest = self.without(name)
            return int(rest.blind.sum()), float(np.sum(rest.direction_errors[~rest.blind] ** 2))

        return min(self.undetermined, key=left)

    def sentences(self) -> list[str]:
        """What the data do not see, in words; empty where all is well."""
        unseen = self.blind & (self.eigenvalues == 0)
        said = []
        for row in sparse_basis(self.directions[unseen]):
            floor = self._floor(row[None])[0]  # what it hides would be of use where it is above 1 / limit²
            hidden = 1.0 / np.sqrt(floor) if floor * self.limit**2 > 1.0 else np.inf
            said.append(blind_sentence(self.free, row, hidden=float(hidden)))
        for k in np.flatnonzero(self.blind & ~unseen):
            said.append(blind_sentence(self.free, self.directions[k], float(self.direction_errors[k])))
        if said:
            others = "; those of the others hold where this point lies along what is not seen"
            all_of_them = len(self.undetermined) == len(self.free)
            said.append(f"no standard error of {', '.join(self.undetermined)}{'' if all_of_them else others}")
        if self.best_fixed:
            errors = self.without(self.best_fixed).log_standard_errors
            known = ", ".join(f"{one} {percent(error)}" for one, error in errors.items())
            said.append(f"best fixed: {self.best_fixed}; then the errors are: {known}")
        return said

    def rows(self) -> list[dict[str, Any]]:
        """One row per direction: eigenvalue, error in percent, what it is in words, and its components."""
        table = []
        for k, direction in enumerate(self.directions):
            words, largest = combination(self.free, direction)
            table.append(
                {
                    "eigenvalue": float(self.eigenvalues[k]),
                    "noise_floor": float(self.noise_floor[k]),
                    "error_percent": float(100 * self.direction_errors[k]),
                    "blind": bool(self.blind[k]),
                    "combination": words,
                    "combination_known_to": percent(float(self.direction_errors[k]) / largest),
                    **dict(zip(self.free, direction.tolist(), strict=True)),
                }
            )
        return table

    def asdict(self) -> dict[str, Any]:
        """Plain data, derived values included."""
        return {
            **{name: getattr(self, name) for name in self.__dataclass_fields__},
            **{name: getattr(self, name) for name in ("matrix", "log_covariance", "log_standard_errors")},
            **{"status": self.status, "undetermined": self.undetermined},
            **{"best_fixed": self.best_fixed, "sentences": self.sentences(), "directions": self.rows()},
        }

    def save(self, path: str | Path) -> None:
        """`asdict` as JSON."""
        write_json(path, self.asdict())

    @staticmethod
    @reads_saved("account of what data determine")
    def load(path: str | Path) -> "Information":
        """Read what `save` wrote.

        Raises:
            InputError: The file is something else, or damaged.
        """
        return Information.fromdict(read_json(path))

    @staticmethod
    def fromdict(data: Mapping[str, Any]) -> "Information":
        """Read what `asdict` gave, as JSON keeps it."""
        square, noise = (np.array(data[name], dtype=float) for name in ("data", "noise"))
        return Information(tuple(data["free"]), square, noise, dict(data["prior"]), data["limit"])

    def _floor(self, directions: Float[np.ndarray, "direction free"]) -> np.ndarray:
        squares = directions**2
        return SIGNIFICANT * np.sqrt(2.0 * np.sum((squares @ self.noise) * squares, axis=1))


def precision(prior: Mapping[str, float], free: Sequence[str]) -> Float[np.ndarray, " free"]:
    """1 / τ² of every free parameter, 0 where there is no prior."""
    return np.array([1.0 / prior[name] ** 2 if name in prior else 0.0 for name in free])
