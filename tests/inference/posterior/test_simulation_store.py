"""The store of simulations: what goes in comes out, whatever is done to the file; and batches of one size."""

import errno
import os
import shutil
import subprocess
import sys
import textwrap
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from simulators import observables_named, parameters_named

from yeastfit import InputError
from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.inference.imaging import Imaging
from yeastfit.inference.resolution import Resolution
from yeastfit.inference.simulator import Replicates, Simulator, about_of, seed_of
from yeastfit.inference.store.cached_simulator import CachedSimulator
from yeastfit.inference.store.simulation_store import Store, opened_store
from yeastfit.inference.store.simulations import ROOM, Simulations
from yeastfit.inference.targets import Targets
from yeastfit.model.model import Model
from yeastfit.observable import Observable
from yeastfit.offlattice.masks.ellipse_mask import Ellipses
from yeastfit.offlattice.simulator import OfflatticeSimulator
from yeastfit.parameter_set import ParameterSet
from yeastfit.seeds import Stream, stream_of

FREE, LABELS = ("mobility", "aspect_ratio"), ("area", "compactness", "radius")


def rows(count: int, first: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Made-up simulations, told apart by their seeds."""
    seeds = np.arange(first, first + count)
    values = seeds[:, None] + np.array([0.25, 0.5])
    statistics = np.sqrt(seeds[:, None] + np.array([1.0, 2.0, 3.0]))
    statistics[seeds % 7 == 3] = np.nan
    return values, seeds, statistics


def assert_same(found: tuple[np.ndarray, ...], expected: tuple[np.ndarray, ...]) -> None:
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


class Doubling:
    """Twice the parameters, and the number of calls and the size of each."""

    parameters, observables = parameters_named(FREE), observables_named(LABELS)

    def __init__(self) -> None:
        self.sizes: list[int] = []

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        self.sizes.append(len(values))
        return np.column_stack([2 * values, seeds]).astype(np.float32)


# --- seeds ------------------------------------------------------------------------------------------------------------


def test_seeds_depend_on_run_and_number_alone() -> None:
    seeds = seed_of(5, np.arange(1000))
    np.testing.assert_array_equal(seed_of(5, [17, 3]), seeds[[17, 3]])
    assert len({*seeds.tolist(), *seed_of(6, np.arange(1000)).tolist()}) == 2000
    assert seeds.min() >= 0
    assert seeds.max() < 2**32
    for wrong in (-1, 2**64):
        with pytest.raises(InputError, match=f"seed is {wrong}, it must be a whole number from 0 to {2**64 - 1}"):
            seed_of(wrong, [0])
        with pytest.raises(InputError, match=f"seed is {wrong}, it must be a whole number from 0 to {2**64 - 1}"):
            stream_of(wrong, Stream.PRIOR, 0)


# --- the store --------------------------------------------------------------------------------------------------------


def test_what_goes_in_comes_out_also_after_growth(tmp_path: Path) -> None:
    path, count = tmp_path / "simulations.h5", 3 * ROOM + 5
    with Store(path, FREE, LABELS) as store:
        for first in range(0, count, 100):
            store.append(*rows(min(100, count - first), first))
        assert_same(store.all(), rows(count))
    with Store(path, FREE, LABELS) as store:
        assert len(store) == count
        assert store.notes == []
        assert_same(store.all(), rows(count))
    with h5py.File(path) as file:  # for whoever does not use this package
        np.testing.assert_array_equal(file["simulations"]["values"][:count], rows(count)[0])


def test_simulations_are_found_by_parameters_and_seed(tmp_path: Path) -> None:
    with Store(tmp_path / "simulations.h5", FREE, LABELS) as store:
        store.append(*rows(10))
        values, seeds, statistics = rows(10)
        values[4, 0] = np.nextafter(values[4, 0], 9)
        seeds[6] += 100
        known, found = store.find(values, seeds)
        assert np.flatnonzero(~known).tolist() == [4, 6]
        np.testing.assert_array_equal(found[known], statistics[known])
        assert np.isnan(found[~known]).all()


def test_duplicates_are_kept_once(tmp_path: Path) -> None:
    with Store(tmp_path / "simulations.h5", FREE, LABELS) as store:
        store.append(*rows(10))
        store.append(*rows(10, first=5))
        store.append(*(np.concatenate([one, one]) for one in rows(3, first=15)))
        assert_same(store.all(), rows(18))


def test_a_disk_too_full_to_grow_on_costs_nothing_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And leaves no other file behind."""

    def full(path: Path, image: bytes) -> None:
        with path.open("wb") as file:
            file.write(image[: len(image) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "simulations.h5"
    with Store(path, FREE, LABELS) as store:
        store.append(*rows(ROOM))
        with monkeypatch.context() as patch:
            patch.setattr(Path, "write_bytes", full)
            with pytest.raises(OSError, match="No space left on device"):
                store.append(*rows(8, ROOM))
    assert list(tmp_path.iterdir()) == [path]
    with Store(path, FREE, LABELS) as store:
        assert_same(store.all(), rows(ROOM))
        store.append(*rows(8, ROOM))
        assert_same(store.all(), rows(ROOM + 8))


def test_a_kill_between_any_two_writes_loses_nothing(tmp_path: Path) -> None:
    path, killed = tmp_path / "simulations.h5", tmp_path / "killed.h5"
    with Store(path, FREE, LABELS) as store:
        for first in range(0, 1200, 8):
            store.append(*rows(8, first))
            if first in (0, 8, 400, ROOM - 8, ROOM, 1192):
                shutil.copy(path, killed)
                with Store(killed, FREE, LABELS) as other:
                    assert other.notes == []
                    assert_same(other.all(), rows(first + 8))


@pytest.mark.parametrize("lost", [1, 3, 50, 60, 1000, 20000])
def test_a_file_that_lost_its_end_loses_what_was_there_and_can_be_added_to(tmp_path: Path, lost: int) -> None:
    path = tmp_path / "simulations.h5"
    with Store(path, FREE, LABELS) as store:
        store.append(*rows(ROOM))
        width = store.all()[0].itemsize * (1 + len(FREE) + len(LABELS)) + 4
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - lost)
    left = ROOM - int(np.ceil(lost / width))
    with Store(path, FREE, LABELS) as store:
        assert_same(store.all(), rows(left))
        assert store.notes == [f"simulations.h5 was torn: {left} simulations are whole, what followed is gone"]
        store.append(*rows(ROOM))
    with Store(path, FREE, LABELS) as store:
        assert store.notes == []
        assert_same(store.all(), rows(ROOM))


def test_a_row_torn_in_the_middle_costs_that_row(tmp_path: Path) -> None:
    path = tmp_path / "simulations.h5"
    with Store(path, FREE, LABELS) as store:
        store.append(*rows(20))
    with h5py.File(path, "r+") as file:
        torn = file["simulations"][11]
        torn["statistics"][1] += 1e-9
        file["simulations"][11] = torn
    with Store(path, FREE, LABELS) as store:
        assert_same(store.all(), tuple(np.delete(one, 11, axis=0) for one in rows(20)))
        assert store.notes == ["simulations.h5: 19 simulations are whole, 1 damaged: left out"]


def test_killed_while_it_writes(tmp_path: Path) -> None:
    """Killed after the writer said how far it was: all it had said is there, whole, and little more."""
    path = tmp_path / "simulations.h5"
    code = """
        import sys
        import numpy as np
        from yeastfit.inference.store.simulation_store import Store
        with Store(sys.argv[1], ("a",), ("b",)) as store:
            for n in range(len(store), 100000):
                store.append(np.array([[float(n)]]), np.array([n]), np.array([[n / 7]]))
                print(n, flush=True)
    """
    command = [sys.executable, "-c", textwrap.dedent(code), str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        for _ in range(2500):
            said = int(writer.stdout.readline())
        writer.kill()
        said = max([said, *(int(line) for line in writer.stdout if line.endswith("\n"))])
    with Store(path, ("a",), ("b",)) as store:
        values, seeds, statistics = store.all()
    assert len(seeds) in (said + 1, said + 2)
    np.testing.assert_array_equal(seeds, np.arange(len(seeds)))
    np.testing.assert_array_equal(values[:, 0], seeds)
    np.testing.assert_array_equal(statistics[:, 0], seeds / 7)


def test_a_file_in_use_is_said_to_be(tmp_path: Path) -> None:
    path = tmp_path / "simulations.h5"
    Store(path, FREE, LABELS).close()
    code = "import h5py, sys; file = h5py.File(sys.argv[1], 'r+'); print(file.mode, flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "r+\n"
        with pytest.raises(InputError, match=r"simulations\.h5 is in use by another process"):
            Store(path, FREE, LABELS)
        other.communicate("")
    Store(path, FREE, LABELS).close()


def test_a_file_is_held_while_it_grows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = """
        import sys
        from yeastfit.inference.store.simulation_store import Store
        Store(sys.argv[1], ("mobility", "aspect_ratio"), ("area", "compactness", "radius"))
    """
    path, write, told = tmp_path / "simulations.h5", Path.write_bytes, list[str]()

    def slow(temporary: Path, image: bytes) -> None:
        write(temporary, image)
        command = [sys.executable, "-c", textwrap.dedent(code), str(path)]
        told.append(subprocess.run(command, capture_output=True, text=True).stderr)

    with Store(path, FREE, LABELS) as store:
        monkeypatch.setattr(Path, "write_bytes", slow)
        store.append(*rows(ROOM + 1))
    assert len(told) == 1
    assert "simulations.h5 is in use by another process" in told[0]


def test_a_file_that_another_process_replaced_is_not_written_to(tmp_path: Path) -> None:
    """Nor one that was removed: rows would be gone with it."""
    path, other = tmp_path / "simulations.h5", tmp_path / "other.h5"
    for change in (lambda: shutil.copy(path, other) and other.replace(path), path.unlink):
        with Store(path, FREE, LABELS) as store:
            store.append(*rows(1))
            change()
            with pytest.raises(InputError, match=r"simulations\.h5: another process replaced or removed the file"):
                store.append(*rows(2))


def test_a_file_is_open_once_in_a_process(tmp_path: Path) -> None:
    """By whatever name; until the store is closed, or nobody has it any more."""
    path, link = tmp_path / "simulations.h5", tmp_path / "link.h5"
    with Store(path, FREE, LABELS) as store:
        link.symlink_to(path)
        for name in (path, link, Path(os.path.relpath(path))):
            with pytest.raises(InputError, match=f"{name} is open already: use that store, or close it"):
                Store(name, FREE, LABELS)
        store.append(*rows(ROOM + 1))
    with Store(link, FREE, LABELS) as store:
        store.append(*rows(2 * ROOM + 1))
    with pytest.raises(InputError, match="holds other simulations") as refused:
        Store(path, FREE, LABELS[::-1])
    unclosed = Store(path, FREE, LABELS)
    assert_same(unclosed.all(), rows(2 * ROOM + 1))
    del unclosed, refused
    with Store(path, FREE, LABELS) as store:
        assert link.is_symlink()
    with pytest.raises(InputError, match="the store is closed"):
        store.append(*rows(1))


def test_a_store_that_could_not_grow_tries_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, image: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "simulations.h5"
    with Store(path, FREE, LABELS) as store:
        with monkeypatch.context() as patch:
            patch.setattr(Path, "write_bytes", full)
            with pytest.raises(OSError, match="No space left on device"):
                store.append(*rows(ROOM + 1))
        store.append(*rows(1, ROOM + 1))
    with Store(path, FREE, LABELS) as store:
        assert_same(store.all(), rows(ROOM + 2))


def test_files_that_are_something_else_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "simulations.h5"
    with Store(path, FREE, LABELS, about="colonies of 3 h") as store:
        store.append(*rows(3))
    for free, labels, about in ((FREE[:1], LABELS, ""), (FREE, LABELS[::-1], ""), (FREE, LABELS, "colonies of 9 h")):
        with pytest.raises(InputError, match=r"simulations\.h5 holds other simulations: .* not "):
            Store(path, free, labels, about)
    path.write_text("mobility,area\n1,2\n")
    with pytest.raises(InputError, match=r"simulations\.h5 is not a file of simulations, or it is damaged"):
        Store(path, FREE, LABELS)
    path.write_text("")
    with pytest.raises(
        InputError, match=r"simulations\.h5 is not a file of simulations, or it is damaged: it is empty"
    ):
        Store(path, FREE, LABELS)
    (tmp_path / "folder.h5").mkdir()
    with pytest.raises(InputError, match=r"folder\.h5: is no regular file, need a file of simulations, or none"):
        Store(tmp_path / "folder.h5", FREE, LABELS)
    with h5py.File(tmp_path / "other.h5", "w", libver=("earliest", "v108")) as file:
        file["x"] = 3
    with pytest.raises(InputError, match=r"other\.h5: no simulations can be read, the file is damaged"):
        Store(tmp_path / "other.h5", FREE, LABELS)
    (tmp_path / "link.h5").symlink_to("nowhere")
    with pytest.raises(InputError, match=r"link\.h5: is a link to nothing, need a file of simulations, or none"):
        Store(tmp_path / "link.h5", FREE, LABELS)
    assert (tmp_path / "link.h5").is_symlink()


@pytest.mark.parametrize("left", [0, 30, 90, 700, 2000])
def test_a_file_that_lost_its_beginning_is_said_to_be_damaged(tmp_path: Path, left: int) -> None:
    path = tmp_path / "simulations.h5"
    with Store(path, FREE, LABELS) as store:
        store.append(*rows(20))
    with path.open("r+b") as file:
        file.truncate(left)
    with pytest.raises(InputError, match=r"simulations\.h5.* damaged"):
        Store(path, FREE, LABELS)


def test_a_damaged_byte_is_said_or_costs_its_row_wherever_it_is(tmp_path: Path) -> None:
    """Every range of the file: a byte is changed, or the end is lost. What is read is as it was written."""
    path = tmp_path / "simulations.h5"
    with Store(path, FREE, LABELS) as store:
        store.append(*rows(ROOM))
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    written = {row.tobytes() for row in np.column_stack([*rows(ROOM)])}
    places = np.unique(np.concatenate([np.arange(40), rng.integers(0, 7000, 60), rng.integers(0, len(whole), 60)]))
    read = list[int]()
    for place in places.tolist():
        flipped = bytearray(whole)
        flipped[place] ^= int(rng.integers(1, 256))
        for damaged in (flipped, whole[:place]):
            path.write_bytes(damaged)
            try:
                with Store(path, FREE, LABELS) as store:
                    found = {row.tobytes() for row in np.column_stack(store.all())}
            except InputError:
                continue
            assert found <= written
            read.append(len(found))
            assert len(found) >= ROOM - 1 or damaged is not flipped
    assert len(read) > 60
    assert len(read) < 2 * len(places) - 60


@dataclass(frozen=True)
class Shifted:
    """A simulator with a setting; what it may say of itself is `about`."""

    shift: float

    @property
    def parameters(self) -> ParameterSet:
        return parameters_named(("a",))

    @property
    def observables(self) -> tuple[Observable, ...]:
        return observables_named(("s",))

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        return values + self.shift


class Told(Shifted):
    about = "told"


def test_simulations_of_another_simulator_are_refused(tmp_path: Path) -> None:
    """By its plain settings, or by what it says of itself, whatever wraps it."""
    path = tmp_path / "s.h5"
    with opened_store(path, Shifted(0.5)) as store:
        store.append(np.ones((1, 1)), np.ones(1, np.uint64), np.ones((1, 1)))
    with opened_store(path, Replicates(Shifted(0.5), 3)) as store:
        assert len(store) == 1
    for other, told in ((Shifted(0.25), "shift 0.5, not shift 0.25"), (Told(0.5), "they are of shift 0.5, not told")):
        with pytest.raises(InputError, match=f"s.h5 holds other simulations: .*{told}"):
            opened_store(path, other)


@pytest.mark.parametrize("about", [None, "", "shift 0.5", "colonies of 3 h"])
def test_an_open_store_is_one_simulators(tmp_path: Path, about: str | None) -> None:
    """Whatever its file says; and whatever wraps the simulator."""
    kept: AbstractContextManager[Simulations] = nullcontext(Simulations("a", "s"))
    if about is not None:
        kept = Store(tmp_path / "s.h5", "a", "s", about)
    with kept as store:
        for same in (Shifted(0.5), Replicates(Shifted(0.5), 3)):
            assert CachedSimulator(same, 4, store)(np.ones((1, 1)), np.ones(1, np.uint64)) == 1.5
            assert opened_store(store, same).__enter__() is store
        told = r"store holds other simulations: they are of shift 0\.5, not shift 0\.25; take another store"
        with pytest.raises(InputError, match=told):
            CachedSimulator(Shifted(0.25), 4, store)
        with pytest.raises(InputError, match=told):
            opened_store(store, Shifted(0.25))


def test_a_file_says_of_what_it_is_after_it_has_grown(tmp_path: Path) -> None:
    path = tmp_path / "simulations.h5"
    Store(path, FREE, LABELS, "colonies of 3 h").close()
    with Store(path, FREE, LABELS) as store:
        store.append(*rows(ROOM + 1))
    with pytest.raises(InputError, match="they are of colonies of 3 h, not colonies of 9 h"):
        Store(path, FREE, LABELS, "colonies of 9 h")


def test_colonies_of_other_rules_values_or_grids_are_others() -> None:
    targets = Targets.from_means({"radius": [1.0]}, [1.5], imaging=Imaging(extent=3.0))
    colony = partial(ColonySimulator.of, targets, ["mobility"])
    cells = partial(OfflatticeSimulator.of, ["radius"], cells=100)
    kinds: list[Simulator] = [
        colony(),
        colony(fixed={"aspect_ratio": 0.4}),
        colony(resolution=Resolution(dt=0.01, spacing=0.2)),
        colony(model=Model.of({"medium": {"rule": "dish"}})),
        cells(),
        cells(delay=0.1),
        cells(area=50.0),
        cells(draw=partial(Ellipses.of, pixel_size=2.0)),
    ]
    assert len({about_of(one) for one in kinds}) == len(kinds)
    assert about_of(kinds[0]) == about_of(colony())
    assert about_of(kinds[4]) == about_of(cells(threads=2))


def test_a_closed_store_says_so(tmp_path: Path) -> None:
    store = Store(tmp_path / "simulations.h5", FREE, LABELS)
    store.close()
    with pytest.raises(InputError, match="the store is closed"):
        store.append(*rows(1))


def test_simulations_of_another_run_are_found_and_remembered() -> None:
    store = Simulations(FREE, LABELS)
    store.append(*rows(3))
    assert len(store.reused[0]) == 0
    store.reuse(*rows(10))
    assert_same(store.all(), rows(10))
    np.testing.assert_array_equal(store.reused[0], rows(10)[0])
    known, _ = store.find(*rows(10)[:2])
    assert known.all()


# --- batches ----------------------------------------------------------------------------------------------------------


def test_batches_have_one_size_and_nothing_is_simulated_twice(tmp_path: Path) -> None:
    simulator = Doubling()
    assert isinstance(simulator, Simulator)
    values, seeds, _ = rows(10)
    with Store(tmp_path / "simulations.h5", FREE, LABELS) as store:
        recorded = CachedSimulator(simulator, 4, store)
        found = recorded(values, seeds)
        assert simulator.sizes == [4, 4, 4]
        np.testing.assert_array_equal(found, simulator(values, seeds))
        simulator.sizes.clear()
        np.testing.assert_array_equal(recorded(values[[8, 2]], seeds[[8, 2]]), found[[8, 2]])
        recorded(*rows(6, first=8)[:2])
        assert simulator.sizes == [4]
        assert (recorded.asked, recorded.fresh, len(store)) == (18, 14, 14)
    alone = CachedSimulator(Doubling(), 3)
    np.testing.assert_array_equal(alone(values, seeds), found)
    assert (alone.asked, alone.store.notes) == (10, [])
    np.testing.assert_array_equal(alone(values, seeds), found)
    assert (alone.asked, alone.fresh) == (20, 10)
    assert alone(values[:0], seeds[:0]).shape == (0, 3)


def test_what_a_simulator_gives_is_checked(tmp_path: Path) -> None:
    class Short(Doubling):
        def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
            return super().__call__(values, seeds)[:, :2]

    with pytest.raises(InputError, match=r"simulator gave shape \(4, 2\), expected \(4, 3\)"):
        CachedSimulator(Short(), 4)(*rows(4)[:2])
    with pytest.raises(InputError, match="batch is 0, it must be at least 1"):
        CachedSimulator(Doubling(), 0)
    with Store(tmp_path / "simulations.h5", FREE[:1], LABELS) as store, pytest.raises(InputError, match="store holds"):
        CachedSimulator(Doubling(), 4, store)
