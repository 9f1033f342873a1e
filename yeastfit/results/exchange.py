"""Put new results into the places of earlier ones: all of them, or none where one cannot be moved or a signal comes."""

from collections.abc import Sequence
from contextlib import suppress
from os.path import lexists
from pathlib import Path, PurePath


def exchange(folder: Path, earlier: Sequence[str], new: Sequence[str], *, made: Path, aside: Path) -> None:
    """Move earlier files of a folder aside and new ones into their places, in order.

    Where a file cannot be moved, or Ctrl-C comes, all that were moved go back. A kill meanwhile leaves some of both.

    Arguments:
        folder: Of the results.
        earlier: Names of files that make room, where they are there.
        new: Names of files that come.
        made: Where the new ones are.
        aside: A folder for the earlier ones.

    Raises:
        OSError: A file cannot be moved.
    """
    moved: list[tuple[Path, Path]] = []

    def move(source: Path, target: Path) -> None:
        target.parent.mkdir(parents=True, exist_ok=True)
        moved.append((source, target))  # first: a signal may come when the file has moved
        source.rename(target)

    try:
        for name in earlier:
            if lexists(folder / name):
                move(folder / name, aside / name)
        for name in new:
            move(made / name, folder / name)
    except BaseException:  # KeyboardInterrupt, too
        for source, target in reversed(moved):
            if not lexists(source):
                target.rename(source)
        remove_empty(folder, new)
        raise
    remove_empty(folder, earlier)


def remove_empty(folder: Path, names: Sequence[str]) -> None:
    """Remove the folders that files with these names were in, where they are empty."""
    parents = {one for name in names for one in PurePath(name).parents[:-1]}
    for parent in sorted(parents, key=lambda one: -len(one.parts)):
        with suppress(OSError):
            (folder / parent).rmdir()
