"""The folder of results: whose it is, what is replaced and what is never touched, and kills at every step."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yeastfit.errors import InputError
from yeastfit.results import folder as door
from yeastfit.results.contents import Contents, check_finished, check_own
from yeastfit.results.folder import ResultsFolder, results_folder
from yeastfit.storage import WORK, sha256_of, write_json, written_whole

OLD = {"table.csv": "1", "masks/a.png": "2", "masks/deep/b.png": "3"}
NEW = {"table.csv": "4", "masks/a.png": "2", "pictures/c.png": "5"}
FOREIGN = {"notes.txt": "mine", "masks/mine.png": "mine", "own/masks/a.png": "mine"}


@pytest.fixture(autouse=True, scope="module")
def versionless() -> Iterator[None]:
    """Looking up versions is what writing a manifest takes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(door, "versions", dict)
        yield


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def made(path: Path, files: dict[str, str], command: str = "measure", **how: Any) -> None:
    """One whole run."""
    with results_folder(path, command, **how) as results:
        write(results.partial, files)
        results.finish(inputs=[])


def files_in(path: Path) -> dict[str, str]:
    """Everything but manifest.json."""
    found = {
        file.relative_to(path).as_posix(): file.read_text(errors="replace")
        for file in path.rglob("*")
        if file.is_file()
    }
    return {name: text for name, text in found.items() if name != "manifest.json"}


def assert_whole(path: Path, files: dict[str, str], command: str = "measure") -> None:
    manifest = json.loads((path / "manifest.json").read_text())
    assert manifest["command"] == command
    assert manifest["files"] == {name: sha256_of(path / name) for name in sorted(files)}
    assert files.items() <= files_in(path).items()


def refused(path: Path, command: str = "measure", **how: Any) -> str:
    """What is said; the folder stays as it is."""
    before = files_in(path)
    with pytest.raises(InputError, match="--out: ") as raised, results_folder(path, command, **how):
        pytest.fail("nothing may be computed")
    assert files_in(path) == before
    return str(raised.value)


# --- one run ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("existing", [False, True])
def test_nothing_appears_before_all_is_ready_and_nothing_else_stays(tmp_path: Path, existing: bool) -> None:
    out = tmp_path / "deep" / "out"
    if existing:
        out.mkdir(parents=True)
        (out / ".DS_Store").write_text("of a desktop")
    with results_folder(out, "measure") as results:
        write(results.partial, OLD)
        assert {path.name for path in out.iterdir()} - {".DS_Store"} == {WORK}
        with pytest.raises(
            InputError, match=r"out holds an unfinished run of yeastfit measure: wait for it, or repeat"
        ):
            check_finished(out)
        results.finish(inputs=[], seed=3, passed=True)
    check_finished(out)
    assert_whole(out, OLD)
    assert set(files_in(out)) - {".DS_Store"} == set(OLD)
    manifest = json.loads((out / "manifest.json").read_text())
    assert (manifest["seed"], manifest["passed"], manifest["inputs"]) == (3, True, {})


def test_a_run_that_fails_leaves_no_trace(tmp_path: Path) -> None:
    def failing(path: Path) -> None:
        with results_folder(path, "measure") as results:
            write(results.partial, NEW)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        failing(tmp_path / "deep" / "out")
    assert not list(tmp_path.iterdir())
    made(tmp_path / "out", OLD)
    with pytest.raises(ZeroDivisionError):
        failing(tmp_path / "out")
    assert_whole(tmp_path / "out", OLD)
    assert files_in(tmp_path / "out") == OLD


def test_a_run_replaces_the_files_of_the_one_before_and_no_others(tmp_path: Path) -> None:
    made(tmp_path, OLD)
    write(tmp_path, FOREIGN)
    (tmp_path / "masks" / "deep" / "b.png").unlink()  # what is gone is nobody's
    made(tmp_path, NEW)
    assert_whole(tmp_path, NEW)
    assert files_in(tmp_path) == NEW | FOREIGN
    assert not (tmp_path / "masks" / "deep").exists()


@pytest.mark.parametrize(("command", "stored"), [("measure", ()), ("infer", ("run.json", "kept"))])
def test_a_file_in_an_unfinished_folder_is_told_before_anything_is_computed(
    tmp_path: Path, command: str, stored: tuple[str, ...]
) -> None:
    resume = True if stored else None
    (tmp_path / WORK).mkdir()
    write_json(tmp_path / WORK / "owner.json", {"command": command, "files": {}})
    write(tmp_path, dict.fromkeys(stored, "of the run"))
    with results_folder(tmp_path, command, resume=resume, stored=stored):
        pass  # what a run has there is in nobody's way
    write_json(tmp_path / WORK / "owner.json", {"command": command, "files": {}})
    write(tmp_path, {"table.csv": "mine", ".hidden": "mine"})
    said = refused(tmp_path, command, resume=resume, stored=stored)
    assert f"holds an unfinished run of yeastfit {command} and table.csv, which yeastfit did not write" in said


def test_a_folder_that_was_removed_under_a_run_does_not_become_half_a_result(tmp_path: Path) -> None:
    with results_folder(tmp_path / "out", "measure") as results:
        shutil.rmtree(tmp_path / "out")
        results.partial.mkdir(parents=True)
        write(results.partial, NEW)
        with pytest.raises(InputError, match="out was removed or emptied while the command ran"):
            results.finish(inputs=[])
    assert not (tmp_path / "out" / "manifest.json").exists()


@pytest.mark.parametrize("change", ["masks/a.png", "gone", "link"])
def test_what_a_run_keeps_is_what_it_wrote(tmp_path: Path, change: str) -> None:
    """A folder without a list is of an earlier version and taken as it is."""
    with results_folder(tmp_path, "measure") as results:
        write(results.partial / "kept", OLD)
        place = results.keep("kept")
        results.check_kept("kept")
        if change == "gone":
            (place / "table.csv").unlink()
        elif change == "link":
            (place / "table.csv").rename(tmp_path / "elsewhere.csv")
            (place / "table.csv").symlink_to(tmp_path / "elsewhere.csv")
        else:
            (place / change).write_text("9")
        with pytest.raises(InputError, match=r"--resume: .*kept.* (has changed|is gone) since the run wrote it"):
            results.check_kept("kept")
        (place / "sha256.json").unlink()
        results.check_kept("kept")


def test_a_run_goes_on_in_files_of_its_own_alone(tmp_path: Path) -> None:
    """A link is refused; what has another name, too, is copied, so that nothing is written under that."""
    write(tmp_path, {"out/store.h5": "1", "elsewhere/store.h5": "2"})
    os.link(tmp_path / "out" / "store.h5", tmp_path / "backup.h5")
    check_own(tmp_path / "out", ("store.h5", "not there"))
    (tmp_path / "out" / "store.h5").write_text("more")
    assert (tmp_path / "backup.h5").read_text() == "1"
    (tmp_path / "out" / "store.h5").unlink()
    (tmp_path / "out" / "store.h5").symlink_to(tmp_path / "elsewhere" / "store.h5")
    with pytest.raises(InputError, match=r"store\.h5 is a link, which yeastfit does not make: put the file"):
        check_own(tmp_path / "out", ("store.h5",))


def test_a_file_that_comes_while_a_run_goes_on_stays(tmp_path: Path) -> None:
    """So does one that is changed, and the run's results are not lost either."""

    def disturbed(path: Path, name: str) -> None:
        with results_folder(path, "measure") as results:
            write(results.partial, NEW)
            write(path, {name: "mine"})
            results.finish(inputs=[])

    for number, name in enumerate(("pictures/c.png", "pictures", "masks/a.png")):
        made(out := tmp_path / str(number), OLD)
        with pytest.raises(
            InputError, match=f"{name} in .* came or changed while the command ran, or .*: move it away"
        ):
            disturbed(out, name)
        assert (out / name).read_text() == "mine"
        assert files_in(out / WORK / "results") == NEW
        assert Contents.of(out).finished


# --- what is refused --------------------------------------------------------------------------------------------------


def test_folders_of_others_are_refused_with_what_is_in_the_way_and_a_way_out(tmp_path: Path) -> None:
    write(foreign := tmp_path / "foreign", {f"{name}.txt": "" for name in "abcde"})
    said = refused(foreign)
    assert "holds a.txt, b.txt, c.txt and 2 more, which yeastfit did not write: give another folder" in said
    assert "a.txt" in refused(foreign, overwrite=True)

    made(other := tmp_path / "other", OLD, "simulate")
    said = refused(other)
    assert "results of yeastfit simulate: give another folder, or --overwrite to replace its 3 files" in said

    with results_folder(tmp_path / "unfinished", "measure") as results:
        results._own(dict.fromkeys(OLD, ("0",)))
        unfinished = shutil.copytree(results.path, tmp_path / "killed")
    for overwrite in (False, True):
        said = refused(unfinished, "simulate", overwrite=overwrite)
        assert "an unfinished run of yeastfit measure: give another folder, or repeat that command" in said
    made(unfinished, OLD)
    assert files_in(unfinished) == OLD

    write_json((earlier := tmp_path / "earlier") / "manifest.json", {"command": "measure", "versions": {}})
    for overwrite in (False, True):
        assert "an earlier version of yeastfit, whose manifest.json lists no files" in refused(
            earlier, overwrite=overwrite
        )

    made(changed := tmp_path / "changed", OLD)
    (changed / "table.csv").write_text("by hand")
    assert "holds table.csv, changed since yeastfit wrote it: give another folder, or --overw" in refused(changed)
    made(changed, NEW, overwrite=True)
    assert files_in(changed) == NEW


def test_overwrite_removes_what_the_manifest_lists_and_nothing_else(tmp_path: Path) -> None:
    made(tmp_path, OLD, "simulate")
    write(tmp_path, FOREIGN)
    made(tmp_path, NEW, overwrite=True)
    assert_whole(tmp_path, NEW)
    assert files_in(tmp_path) == NEW | FOREIGN


def test_a_folder_that_is_read_from_is_not_written_to(tmp_path: Path) -> None:
    made(tmp_path / "out", OLD)
    for file in (tmp_path / "out" / "table.csv", tmp_path / "out" / "masks" / "deep" / "b.png"):
        for overwrite in (False, True):
            assert "holds the data, need another folder" in refused(tmp_path / "out", reads=[file], overwrite=overwrite)


def test_places_that_cannot_be_written_to_are_said_before_anything_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "nowhere").symlink_to(tmp_path / "missing" / "folder")
    places = [tmp_path / "file", tmp_path / "file" / "below", tmp_path / "new" / ("x" * 300), tmp_path / "loop"]
    before = sorted(tmp_path.iterdir())
    for place in [*places, tmp_path / "nowhere", Path("/proc/yeastfit")]:
        with pytest.raises(InputError, match="--out: cannot write to"), results_folder(place, "fit"):
            pytest.fail("nothing may be computed")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=0))
    with pytest.raises(InputError, match="No space left on device"), results_folder(tmp_path / "out", "fit"):
        pytest.fail("nothing may be computed")
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_said(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="Permission denied"), results_folder(tmp_path / "out", "fit"):
        pytest.fail("nothing may be computed")
    tmp_path.chmod(0o700)


# --- two processes ----------------------------------------------------------------------------------------------------

HOLDER = """
import sys, time
from pathlib import Path
from yeastfit.results.folder import results_folder
with results_folder(sys.argv[1], "measure") as results:
    (results.partial / "half.csv").write_text("half")
    print("inside", flush=True)
    sys.stdin.read()
    results.finish(inputs=[])
"""


def test_a_second_process_is_refused_by_name_and_a_dead_one_blocks_nobody(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for killed in (False, True):
        with subprocess.Popen(
            [sys.executable, "-c", HOLDER, str(out)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as holder:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "inside\n"
            assert f"out is in use: process {holder.pid} on " in refused(out)
            if killed:
                holder.send_signal(signal.SIGKILL)
            holder.communicate("")
    assert Contents.of(out).finished
    assert (out / WORK / "results" / "half.csv").is_file()
    made(out, NEW)
    assert {path.name for path in out.iterdir()} == {"manifest.json", "table.csv", "masks", "pictures"}


# --- kills ------------------------------------------------------------------------------------------------------------


class Killed(BaseException):
    """Nothing is tidied up after it."""


def killed_at(step: int, run: Callable[[], None], monkeypatch: pytest.MonkeyPatch) -> bool:
    """Run, but stop dead before the step-th change of the disk; whether that came."""
    left = [step]

    def stopping(change: Callable[..., Any]) -> Callable[..., Any]:
        def changed(*arguments: Any, **options: Any) -> Any:
            left[0] -= 1
            if left[0] < 0:
                raise Killed
            return change(*arguments, **options)

        return changed

    with monkeypatch.context() as patch:
        for name in ("replace", "rename", "unlink", "rmdir", "mkdir", "write_text"):
            patch.setattr(Path, name, stopping(getattr(Path, name)))
        patch.setattr(shutil, "rmtree", stopping(shutil.rmtree))
        patch.setattr(ResultsFolder, "close", lambda folder: None if left[0] < 0 else CLOSE(folder))
        patch.setattr(door, "_let_go", lambda lock, made: lock.release() if left[0] < 0 else LET_GO(lock, made))
        try:
            run()
        except Killed:
            return True
    return False


CLOSE, LET_GO = ResultsFolder.close, door._let_go


@pytest.mark.thorough
@pytest.mark.parametrize("before", [{}, OLD])
def test_killed_at_any_step_a_folder_is_whole_or_unfinished_and_the_next_run_makes_it_whole(
    tmp_path: Path, before: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    step, states = 0, list[bool]()
    while True:
        out = tmp_path / str(step)
        if before:
            made(out, before)
            write(out, FOREIGN)
        kept = FOREIGN if before else {}
        if not killed_at(step, partial(made, out, NEW), monkeypatch):
            break
        found = Contents.of(out)
        states.append(found.finished)
        assert found.command in ("", "measure")
        assert kept.items() <= files_in(out).items() if out.exists() else not kept
        if found.finished:
            assert_whole(out, NEW if "pictures/c.png" in files_in(out) else before)
        elif found.command:
            with pytest.raises(InputError, match="unfinished run of yeastfit measure"):
                check_finished(out)
            assert "unfinished run of yeastfit measure" in refused(out, "simulate", overwrite=True)
        killed_at(step // 2, partial(made, out, NEW), monkeypatch)  # and once more
        made(out, NEW)
        assert_whole(out, NEW)
        assert files_in(out) == NEW | kept
        assert not (out / WORK).exists()
        step += 1
    assert step > 15
    assert {True, False} == set(states)


def test_temporary_files_of_a_killed_run_do_not_stay(tmp_path: Path) -> None:
    with results_folder(tmp_path / "out", "fit") as results:
        with written_whole(results.path / "problems.json") as temporary:
            assert temporary.parent == results.path / WORK
        killed = shutil.copytree(results.path, tmp_path / "killed")
    (killed / WORK / ".problems-abc.json").write_text("half")
    made(killed, NEW, "fit", stored=("problems.json",))
    assert not (killed / WORK).exists()


# --- lists that cannot be trusted -------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=60)
@given(st.text(max_size=20) | st.sampled_from(["../victim", "/victim", "a/../../victim", ".", "", "\0", WORK]))
def test_a_manifest_leads_to_no_file_outside(tmp_path_factory: pytest.TempPathFactory, name: str) -> None:
    where = tmp_path_factory.mktemp("where")
    write(where, {"victim": "mine", "out/table.csv": "1"})
    listed = {name: sha256_of(where / "victim"), "table.csv": sha256_of(where / "out" / "table.csv")}
    write_json(where / "out" / "manifest.json", {"command": "measure", "files": listed})
    for command in ("measure", "simulate"):
        try:
            made(where / "out", NEW, command, overwrite=True)
        except InputError:
            assert files_in(where / "out")["table.csv"] == "1"
    assert (where / "victim").read_text() == "mine"


def test_links_in_a_folder_are_not_followed(tmp_path: Path) -> None:
    made(out := tmp_path / "out", OLD)
    write(tmp_path / "elsewhere", {"a.png": "2", "deep/b.png": "3"})
    shutil.rmtree(out / "masks")
    (out / "masks").symlink_to(tmp_path / "elsewhere")
    for overwrite in (False, True):
        assert "masks/a.png, masks/deep/b.png in place of a file that yeastfit wrote: move it" in refused(
            out, overwrite=overwrite
        )
    with pytest.raises(InputError, match="masks"):
        made(out, {"other.csv": "1"}, overwrite=True)
    (tmp_path / "empty").mkdir()
    (out / "masks").unlink()
    (out / "masks").symlink_to(tmp_path / "empty")
    assert "masks/a.png, masks/deep/b.png in place of a file that yeastfit wrote: move it" in refused(out)
    assert files_in(tmp_path / "elsewhere") == {"a.png": "2", "deep/b.png": "3"}
    (out / "masks").unlink()
    (out / WORK).symlink_to(tmp_path / "elsewhere")
    assert "is a link, which yeastfit does not make" in refused(out)


def test_what_is_in_the_place_of_a_listed_file_or_of_its_folder_stays(tmp_path: Path) -> None:
    made(out := tmp_path / "out", OLD)
    (out / "masks" / "deep" / "b.png").unlink()
    write(out, {"masks/deep/b.png/mine.txt": "mine"})
    for overwrite in (False, True):
        assert "masks/deep/b.png in place of a file that yeastfit wrote" in refused(out, overwrite=overwrite)
    shutil.rmtree(out / "masks" / "deep")
    write(out, {"masks/deep": "mine"})
    made(out, NEW)
    assert files_in(out) == NEW | {"masks/deep": "mine"}


def test_a_pipe_is_no_manifest_and_users_files_beside_those_of_a_run_stay(tmp_path: Path) -> None:
    (tmp_path / "pipe").mkdir()
    os.mkfifo(tmp_path / "pipe" / "manifest.json")
    assert "holds manifest.json, which yeastfit did not write" in refused(tmp_path / "pipe")
    write_json(tmp_path / "out" / WORK / "owner.json", {"command": "measure", "files": {}})
    write(tmp_path / "out" / WORK, {"mine.txt": "mine", "mine/deep.txt": "mine"})
    made(tmp_path / "out", NEW)
    assert files_in(tmp_path / "out") == NEW | {f"{WORK}/mine.txt": "mine", f"{WORK}/mine/deep.txt": "mine"}


@pytest.mark.parametrize(
    "text",
    [
        *(
            b"",
            b"{",
            b"[]",
            b'{"command": 3}',
            b'{"command": ""}',
            b'{"files": {}}',
            b'{"command": "fit", "files": []}',
            b'{"command": "fit", "files": {}}',
        ),
        *(b'{"command": "fit", "files": {"a": 1}}', b"[" * 3000, b"\xff"),
        b'{"command": "fit", "files": {"\\ud800": "0"}}',
    ],
)
def test_a_manifest_that_yeastfit_cannot_have_written_is_a_file_like_any_other(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "manifest.json").write_bytes(text)
    assert "holds manifest.json, which yeastfit did not write" in refused(tmp_path, "fit", overwrite=True)


def test_an_input_that_is_gone_or_another_at_the_end_costs_no_results_and_is_told(tmp_path: Path) -> None:
    """Somebody removed a photograph while others were measured, and edited another."""
    out, photographs = tmp_path / "out", [tmp_path / name for name in ("a.tif", "b.tif", "c.tif")]
    for one in photographs:
        one.write_text(one.name)
    with results_folder(out, "measure", reads=photographs) as results:
        write(results.partial, OLD)
        photographs[0].unlink()
        photographs[1].write_text("edited")
        told = results.finish(inputs=photographs)
    assert_whole(out, OLD)
    known = ["gone when the command ended", "changed while the command ran", sha256_of(photographs[2])]
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["inputs"] == dict(zip(map(str, photographs), known, strict=True))
    assert told == [f"{one} {what}" for one, what in zip(photographs[:2], known[:2], strict=True)]


def test_a_signal_while_a_run_puts_its_things_away_leaves_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clear, calls = door._clear_work, list[Path]()

    def interrupted(work: Path) -> None:
        calls.append(work)
        if len(calls) == 2:  # the first one is before the run
            raise KeyboardInterrupt
        clear(work)

    monkeypatch.setattr(door, "_clear_work", interrupted)
    with pytest.raises(KeyboardInterrupt):
        made(tmp_path / "out", OLD)
    assert not (tmp_path / "out" / WORK).exists()
    assert_whole(tmp_path / "out", OLD)


@pytest.mark.parametrize("stuck", ["manifest.json", "masks/a.png", "pictures/c.png"])
@pytest.mark.parametrize("when", ["refused", "before", "after"])
def test_where_one_file_is_not_replaced_none_is(
    tmp_path: Path, stuck: str, when: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system refuses to move a file, as an immutable one, or a signal comes before it is moved or after."""
    made(out := tmp_path / "out", OLD)
    write(out, FOREIGN)
    before, rename = {**files_in(out), "manifest.json": (out / "manifest.json").read_text()}, Path.rename

    def refusing(source: Path, target: Path) -> Path:
        if out / stuck not in (source, target):
            return rename(source, target)
        if when == "refused":
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM), str(out / stuck))
        monkeypatch.undo()  # one signal comes
        if when == "after":
            rename(source, target)
        raise KeyboardInterrupt

    def again() -> None:
        with results_folder(out, "measure") as results:
            write(results.partial, NEW)
            monkeypatch.setattr(Path, "rename", refusing)
            results.finish(inputs=[])

    with pytest.raises((PermissionError, KeyboardInterrupt)):
        again()
    assert {**files_in(out), "manifest.json": (out / "manifest.json").read_text()} == before
    assert not (out / WORK).exists()
    assert_whole(out, OLD)
    monkeypatch.undo()
    made(out, NEW)
    assert files_in(out) == NEW | FOREIGN
