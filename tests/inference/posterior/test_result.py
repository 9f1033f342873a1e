"""Posteriors: weighted moments and quantiles, what draws are worth, how they ended, and their files."""

import subprocess
import sys
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import wrong_types
from made_posteriors import flat_prior, made_posterior
from scipy import stats
from simulators import observables_named, parameters_named
from stand_in import StandIn

from yeastfit import SAMPLERS, InputError, Prior, infer
from yeastfit.inference.abc.smc import AbcSmc
from yeastfit.inference.posterior.diagnostics import Diagnostics
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.status import Status
from yeastfit.storage import as_json


@dataclass(frozen=True)
class Part:
    share: float
    name: str


@dataclass(frozen=True)
class Reported(Diagnostics):
    """One of each kind of field."""

    parts: tuple[Part, ...]
    matrix: np.ndarray
    pair: tuple[float, int]
    end: str | None

    def sentences(self) -> list[str]:
        return ["the method has a doubt"]


def made_up(values: np.ndarray, weights: np.ndarray | None = None) -> Posterior:
    return made_posterior(
        values,
        weights,
        log_probability=-0.5 * values[..., 0] ** 2,
        settings={"tolerance": 0.1, "observed": [1.0, float("inf")]},
        warnings=("none",),
        diagnostics=Reported((Part(0.1, "a"), Part(np.inf, "b")), np.eye(2), (0.5, 3), None),
        noise=np.eye(1),
        status=Status.TOO_FEW_DRAWS,
    )


def walk(share: float, chains: int, draws: int) -> np.ndarray:
    """x' = share · x + noise, of variance 1: τ = (1 + share) / (1 − share)."""
    rng, rows = np.random.default_rng(0), [np.random.default_rng(1).standard_normal(chains)]
    for _ in range(draws - 1):
        rows.append(share * rows[-1] + np.sqrt(1 - share**2) * rng.standard_normal(chains))
    return np.array(rows).T[..., None]


def test_weighted_draws_have_the_moments_of_what_they_stand_for() -> None:
    """Uniform draws weighted by a Gaussian density."""
    grid = np.linspace(-8, 10, 40001)
    weights = stats.norm(1.0, 2 / 3).pdf(grid)
    posterior = made_up(grid[None, :, None], (weights / weights.sum())[None])
    np.testing.assert_allclose([posterior.mean[0], posterior.sd[0]], [1.0, 2 / 3], rtol=1e-6)
    for level in (0.5, 0.9):
        np.testing.assert_allclose(posterior.interval(level)[0], stats.norm(1.0, 2 / 3).interval(level), atol=1e-4)
    np.testing.assert_allclose(posterior.quantile(0.5), 1.0, atol=1e-4)
    assert posterior.weighted
    np.testing.assert_allclose(posterior.effective_size, 1 / np.sum(posterior.weights**2))


def test_chains_are_worth_their_length_over_tau() -> None:
    posterior = made_up(walk(0.8, 4, 4000))
    assert not posterior.weighted
    assert posterior.effective_size[0] == pytest.approx(16000 / 9, rel=0.15)
    assert made_up(walk(0.0, 4, 4000)).effective_size[0] == pytest.approx(16000, rel=0.1)


def test_chains_that_stand_still_are_worth_little() -> None:
    values = walk(0.8, 4, 4000)
    apart = np.concatenate([values[:3], np.full((1, 4000, 1), 7.0)])
    assert made_up(apart).effective_size[0] < 10
    assert made_up(apart[3:]).effective_size[0] == 1.0
    assert made_up(np.full((3, 50, 1), 7.0)).effective_size[0] == 1.0
    assert 1.0 <= made_up(np.repeat(values[:, :1], 50, axis=1)).effective_size[0] <= 4.0


def test_draws_of_equal_weight() -> None:
    weights = np.array([[0.7, 0.0, 0.3]])
    posterior = made_up(np.array([[[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]]), weights)
    drawn = posterior.drawn(3000, np.random.default_rng(0))
    assert set(map(tuple, drawn.tolist())) == {(1.0, 2.0), (5.0, 6.0)}
    assert np.mean(drawn[:, 0] == 1.0) == pytest.approx(0.7, abs=0.04)


def test_files_keep_every_bit(tmp_path: Path) -> None:
    posterior = made_up(walk(0.5, 2, 50))
    path = tmp_path / "deeper" / "posterior.npz"
    posterior.save(path)
    found = Posterior.load(path)
    for name in [one.name for one in fields(Posterior) if one.name != "diagnostics"]:
        np.testing.assert_equal(getattr(found, name), getattr(posterior, name))
    assert isinstance(found.diagnostics, Reported)
    assert as_json(found.diagnostics.asdict()) == as_json(posterior.diagnostics.asdict())
    assert found.diagnostics.parts == (Part(0.1, "a"), Part(np.inf, "b"))
    assert found.diagnostics.pair == (0.5, 3)
    assert found.sentences() == posterior.sentences()
    assert found.sentences()[0] == "none"
    assert found.sentences()[-1] == "the method has a doubt"
    assert replace(found, warnings=()).warned("one", "two").warnings == ("one", "two")


@pytest.mark.parametrize(
    ("name", "shape", "words"),
    [
        ("values", (2, 3, 4), r"values has shape \(2, 3, 4\), it must be \(2, 50, 4\)"),
        ("observed", (7,), r"observed has shape \(7,\), it must be"),
        ("weights", (2, 50), "weights holds numbers that are not finite"),
    ],
)
def test_arrays_that_do_not_fit_each_other_are_refused(
    name: str, shape: tuple[int, ...], words: str, tmp_path: Path
) -> None:
    path = tmp_path / "posterior.npz"
    made_up(walk(0.5, 2, 50)).save(path)
    with np.load(path) as file:
        arrays = {key: file[key] for key in file.files}
    arrays[name] = np.full(shape, np.nan)
    np.savez(path, **arrays)
    with pytest.raises(InputError, match=words):
        Posterior.load(path)


def test_diagnostics_that_no_imported_file_defines_are_refused() -> None:
    with pytest.raises(InputError, match="diagnostics are of kind 'Elsewhere', which no imported file defines"):
        Diagnostics.restored({"kind": "Elsewhere"})
    assert Diagnostics.restored(Diagnostics().asdict()) == Diagnostics()


@pytest.mark.thorough
def test_a_new_process_reads_the_files_of_all_methods(tmp_path: Path) -> None:
    """Where nothing but the posterior is imported."""
    kinds = ("McmcDiagnostics", "SmcDiagnostics", "EmulatorDiagnostics")
    program = f"""
from yeastfit.inference.posterior.diagnostics import Diagnostics
for kind in {kinds}:
    try:
        Diagnostics.restored({{"kind": kind}})
    except KeyError as missing:  # its fields are asked for
        print(kind, missing)
"""
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert [line.split()[0] for line in found.stdout.splitlines()] == list(kinds)


def test_files_of_something_else_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "posterior.npz"
    made_up(walk(0.5, 2, 50)).save(path)
    path.write_bytes(path.read_bytes()[:-100])
    (tmp_path / "text.npz").write_text("mobility")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    made_up(walk(0.5, 2, 50)).save(tmp_path / "flipped.npz")
    whole = bytearray((tmp_path / "flipped.npz").read_bytes())
    whole[100:110] = b"\xff" * 10  # amid what is compressed
    (tmp_path / "flipped.npz").write_bytes(whole)
    for name in ("posterior.npz", "text.npz", "other.npz", "flipped.npz"):
        with pytest.raises(InputError, match=f"{name}: this is no posterior that was saved whole"):
            Posterior.load(tmp_path / name)
    with pytest.raises(InputError, match=r"nowhere\.npz: there is no such file"):
        Posterior.load(tmp_path / "nowhere.npz")


class Nothing:
    """A simulator of one parameter and one statistic."""

    parameters, observables = parameters_named(("mobility",)), observables_named(("area",))

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        return values


def test_what_is_left_out_is_filled_in_and_the_status_is_what_chains_say() -> None:
    problem = Problem(Nothing(), flat_prior("mobility"), np.array([1.0]), replicates=3)
    long, short = (Posterior.of(problem, walk(0.5, 4, count), simulations=7) for count in (2000, 20))
    assert (long.status, short.status) == (Status.SETTLED, Status.CHAINS_TOO_SHORT)
    assert (long.settled, short.settled) == (True, False)
    assert str(short.status).startswith("not settled: chains are too short")
    assert (long.free, long.labels, long.replicates, long.simulations) == (("mobility",), ("area",), 3, 7)
    np.testing.assert_allclose(long.weights, 1 / 8000)
    assert np.isnan(long.statistics).all()
    assert np.isnan(long.acceptance).all()
    weights = np.linspace(1, 2, 50)[None] / 75
    assert Posterior.of(problem, walk(0.5, 1, 50), weights=weights, simulations=7).settled
    assert Posterior.of(problem, walk(0.5, 1, 2), simulations=7).status is Status.CHAINS_TOO_SHORT
    chosen = Posterior.of(problem, walk(0.5, 4, 2000), simulations=7, status=Status.STILL_MOVING)
    assert chosen.status is Status.STILL_MOVING


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"values": np.ones((2, 50))}, r"values have shape \(2, 50\), they must be draws of 1 parameters"),
        ({"values": np.ones((2, 50, 3))}, r"values have shape \(2, 50, 3\), they must be draws of 1 parameters"),
        ({"weights": np.full(100, 0.01)}, r"weights: the shape is \(100,\), values of \(2, 50, 1\) need \(2, 50\)"),
        ({"statistics": np.ones((50, 1))}, r"statistics: the shape is \(50, 1\), .* need \(2, 50, 1\)"),
        ({"acceptance": 0.1}, "acceptance is 0.1, it must be a row of numbers"),
        ({"status": "settled"}, "status is 'settled', it must be one of the posterior has settled, "),
        ({"warnings": "careful"}, "warnings are 'careful', they must be a list of texts"),
    ],
    ids=lambda one: next(iter(one)) if isinstance(one, dict) else "",
)
def test_what_a_sampler_of_ones_own_may_get_wrong(changed: dict[str, Any], said: str) -> None:
    problem = Problem(Nothing(), flat_prior("mobility"), np.array([1.0]))
    given: dict[str, Any] = {"values": walk(0.5, 2, 50), "simulations": 1} | changed
    with pytest.raises(InputError, match=said):
        Posterior.of(problem, given.pop("values"), **given)


@pytest.mark.usefixtures("unchecked")
def test_what_is_no_sampler_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Nothing(), flat_prior("mobility"), np.array([1.0])
    wrong: Any
    for wrong, said in ((AbcSmc, r"the class AbcSmc: write AbcSmc\(\)"), (3, "method is 3, no sampler")):
        with pytest.raises(InputError, match=said):
            infer(*asked, method=wrong)
    for wrong in (AbcSmc(), Nothing):
        monkeypatch.setitem(SAMPLERS, "mine", wrong)
        with pytest.raises(InputError, match=r"method 'mine' is registered as .*, it must be a dataclass"):
            infer(*asked, method="mine")


def test_what_makes_no_sense_is_refused() -> None:
    values = walk(0.5, 2, 50)
    with pytest.raises(InputError, match="weights at least 0 with sum 1, their sum is 2"):
        made_up(values, np.full((2, 50), 0.02))
    values[0, 0, 0] = np.nan
    with pytest.raises(InputError, match="values must be finite"):
        made_up(values)
    with pytest.raises(InputError, match=r"share is 1.5, it must lie in 0..1"):
        made_up(walk(0.5, 2, 50)).quantile(1.5)
    for level, shown in ((90, "90"), ("0.9", "'0.9'")):
        with wrong_types(), pytest.raises(InputError, match=f"level is {shown}, it must be a number in 0..1, such as"):
            made_up(walk(0.5, 2, 50)).interval(level)  # type: ignore[arg-type]


def test_a_damaged_file_is_named_whatever_its_fault(tmp_path: Path) -> None:
    """Weights that are none, and independent draws of another number of parameters."""
    file = tmp_path / "posterior.npz"
    made_posterior(np.zeros((1, 16, 2)), worth=np.array([5.0, 6.0])).save(file)
    with np.load(file) as saved:
        whole = dict(saved)
    for changed, words in (
        ({"weights": -whole["weights"]}, "weights at least 0"),
        ({"rest": np.array(str(whole["rest"]).replace("[5.0, 6.0]", "-1"))}, "worth has the shape"),
        ({"rest": np.array(str(whole["rest"]).replace("[5.0, 6.0]", "[5.0]"))}, "worth has the shape"),
    ):
        np.savez(file, **{**whole, **changed})
        with wrong_types(), pytest.raises(InputError, match=f"{file}: .*{words}"):
            Posterior.load(file)


class Plain:
    """A sampler that is no dataclass."""

    def __init__(self, share: Any) -> None:
        self.share = share

    def run(self, problem: Problem, *rest: Any) -> Posterior:
        values = problem.prior.sample(80, np.random.default_rng(0))[None]
        return Posterior.of(problem, values, simulations=1)


def test_a_sampler_that_is_no_dataclass_is_run_with_its_attributes_as_settings() -> None:
    simulator = StandIn(free=("mobility", "aspect_ratio"))
    prior, data = Prior.default(simulator.parameters), np.ones(len(simulator.observables))
    with wrong_types():
        assert infer(simulator, prior, data, method=Plain(0.5)).settings == {"share": 0.5}
        with pytest.raises(InputError, match=r"method: share of Plain is .*, which files cannot hold"):
            infer(simulator, prior, data, method=Plain(np.exp))


def test_draws_outside_the_prior_are_refused() -> None:
    simulator = StandIn(free=("mobility", "aspect_ratio"))
    problem = Problem(simulator, Prior.default(simulator.parameters), np.ones(len(simulator.observables)))
    low, high = problem.prior.support[1]
    values = np.full((1, 60, 2), 0.5 * (low + high))
    values[0, :3, 1] = high + 1.0
    with pytest.raises(InputError, match=r"values: 3 of 60 draws lie outside the prior, aspect_ratio is .* to "):
        Posterior.of(problem, values, simulations=1)


def test_results_are_compared_as_objects() -> None:
    """Not by arrays, whose comparison has no single truth."""
    one = made_up(np.zeros((1, 8, 1)))
    assert one == one
    assert one != replace(one)
    assert len({one, replace(one)}) == 2
