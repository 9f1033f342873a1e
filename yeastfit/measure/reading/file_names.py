"""What names of image files say of them: condition, replicate, hours, objective.

A pattern such as "{condition} s{replicate} {hours}h {objective}" is matched with the name of a file without its suffix.
{condition} is any text, {replicate} letters and digits, {hours} a number, {objective} anything without spaces and
underscores, and {} any text that is not read; all else stands for itself. After a space, underscore or hyphen, a name
may go on behind the pattern: "AWRI 796 500um s10 121h 4X binary" matches.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

from yeastfit.errors import InputError
from yeastfit.measure.reading.dataset import text_in
from yeastfit.numbers import HOURS
from yeastfit.text import quoted

FIELDS = {
    "condition": r".+",
    "replicate": r"[A-Za-z0-9]+",
    "hours": r"[0-9]+(?:\.[0-9]+)?",
    "objective": r"[^ _]+",
    "": r".*",
}
"""What each field of a pattern may be, as a regular expression."""

MOST_READINGS = 1000  # that are looked at; of a name that can be read in more ways than one a few are enough
MOST_UNREAD = 4  # {} in a pattern; with more, a name that does not match takes too long to say so
REST = r"(?:[ _-].*)?"


@dataclass(frozen=True)
class NamedImage:
    """What the name of one image says.

    Attributes:
        path: The file.
        condition: Empty where the pattern has none.
        replicate: Name of the colony.
        hours: Since the colony was one cell.
        objective: Empty where the pattern has none.
        rest: What stands behind the pattern.
    """

    path: Path
    condition: str
    replicate: str
    hours: float
    objective: str = ""
    rest: str = ""


@dataclass(frozen=True)
class NamePattern:
    """A pattern of file names.

    Attributes:
        text: As it was given.
        fields: Its fields, in order, without {}.
    """

    text: str
    fields: tuple[str, ...]

    @staticmethod
    def of(text: str) -> "NamePattern":
        """Read a pattern.

        Raises:
            InputError: A field is unknown or appears twice, a brace is open, or {replicate} is missing.
        """
        plain = re.sub(r"(\{\}){2,}", "{}", text)  # any text behind any text is any text
        if plain.count("{}") > MOST_UNREAD:
            raise InputError(
                f"pattern {quoted(text)}: has {{}} {plain.count('{}')} times, need it at most {MOST_UNREAD} times: one "
                "may stand for several words"
            )
        literal = re.sub(r"\{[^{}]*\}", "", text)
        if "{" in literal or "}" in literal:
            raise InputError(f"pattern {quoted(text)}: a brace is open, fields are written {{hours}}")
        fields = tuple(name for name in re.findall(r"\{([^{}]*)\}", text) if name)
        for name in fields:
            if name not in FIELDS:
                known = ", ".join(f"{{{one}}}" for one in FIELDS)
                raise InputError(f"pattern {quoted(text)}: {{{name}}} is unknown, known are {known}")
            if fields.count(name) > 1:
                raise InputError(f"pattern {quoted(text)}: {{{name}}} appears twice")
        if "replicate" not in fields:
            raise InputError(f"pattern {quoted(text)}: has no {{replicate}}, which tells colonies of a condition apart")
        return NamePattern(plain, fields)

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """Text, field, text, …"""
        return tuple(re.split(r"\{([^{}]*)\}", self.text))

    def readings(self, name: str) -> list[dict[str, str]]:
        """What a name can mean: nothing, one thing, or two that differ, with the first fields short and long."""
        found: dict[tuple[str, ...], dict[str, str]] = {}
        for texts in islice(self._readings(name, 0, 0, {}, set()), MOST_READINGS):
            found.setdefault(tuple(texts[field] for field in self.fields), texts)
        return [*found.values()][:1] + [*found.values()][1:][-1:]

    def _readings(
        self, name: str, part: int, at: int, read: dict[str, str], seen: set[tuple[Any, ...]]
    ) -> Iterator[dict[str, str]]:
        """All readings of a name from a place and a part of the pattern on; `seen`: from where there is nothing new."""
        parts = self.parts
        if (part, at, *read.values()) in seen or not name.startswith(parts[part], at):
            return
        seen.add((part, at, *read.values()))
        at += len(parts[part])
        if part + 1 == len(parts):
            if re.fullmatch(REST, name[at:]):
                yield {**read, "rest": name[at:]}
            return
        field, following = parts[part + 1], parts[part + 2]
        for end in range(at, len(name) + 1):
            if name.startswith(following, end) and re.fullmatch(FIELDS[field], name[at:end]):
                more = {field: name[at:end]} if field else {}
                yield from self._readings(name, part + 2, end, read | more, seen)


def named_images(files: Sequence[Path], pattern: NamePattern, hours: float | None = None) -> list[NamedImage]:
    """Read the names of images.

    Arguments:
        files: The images.
        pattern: Of their names.
        hours: Of all images, where the pattern has no {hours}.

    Returns:
        One entry a file, in their order.

    Raises:
        InputError: A name does not match the pattern or can be read in two ways, hours are missing or given twice, or
            two images are of the same colony at the same time.
    """
    if ("hours" in pattern.fields) == (hours is not None):
        wrong = "has no {hours}, give those of all images" if hours is None else "has {hours}, leave out those of all"
        raise InputError(f"pattern {quoted(pattern.text)}: {wrong}")
    images = [_read(path, pattern, hours) for path in files]
    seen: dict[tuple[str, str, float], NamedImage] = {}
    for image in images:
        first = seen.setdefault((image.condition, image.replicate, image.hours), image)
        if first is not image:
            raise InputError(
                f"{quoted(first.path.name)} and {quoted(image.path.name)} are both of replicate {image.replicate}"
                + (f" of {quoted(image.condition)}" if image.condition else "")
                + f" at {image.hours:g} hours: a colony has one image at one time"
            )
    return images


def _read(path: Path, pattern: NamePattern, hours: float | None) -> NamedImage:
    readings = pattern.readings(path.stem)
    if not readings:
        raise InputError(f"{quoted(path.name)} does not match the pattern {quoted(pattern.text)}")
    if len(readings) > 1:
        two = " or ".join(", ".join(f"{name} {quoted(one[name])}" for name in pattern.fields) for one in readings)
        raise InputError(f"{quoted(path.name)} can be read in two ways: {two}; make the pattern longer")
    found = readings[0]
    when = hours if hours is not None else HOURS.read(found["hours"], f"{quoted(path.name)}: hours")
    condition, replicate = (text_in(found, name, quoted(path.name)) for name in ("condition", "replicate"))
    return NamedImage(path, condition, replicate, when, found.get("objective", ""), found["rest"])


def pixel_sizes_of(images: Sequence[NamedImage], sizes: Mapping[str, float]) -> list[float | None]:
    """Size of a pixel in µm of each image, by its objective; None where the file itself has to say it.

    Arguments:
        images: With their objectives.
        sizes: By objective; "" stands for all.

    Raises:
        InputError: An objective has no size, a size belongs to no image, or one is for several objectives.
    """
    if not sizes:
        return [None] * len(images)
    met = dict.fromkeys(image.objective for image in images)
    if "" in sizes:
        if len(met) > 1:
            raise InputError(
                f"images have the objectives {', '.join(map(quoted, met))}, and one pixel size is given for all: give "
                "one for each, or a pattern without {objective}"
            )
        return [sizes[""]] * len(images)
    if missing := [objective for objective in met if objective not in sizes]:
        first = next(image for image in images if image.objective == missing[0])
        what = f"objective {quoted(missing[0])}" if missing[0] else "no objective in its name"
        raise InputError(
            f"{quoted(first.path.name)}: {what}, pixel sizes are given for {', '.join(map(quoted, sizes))}"
        )
    if unused := [objective for objective in sizes if objective not in met]:
        raise InputError(f"no image has the objective {quoted(unused[0])}, met are {', '.join(map(quoted, met))}")
    return [sizes[image.objective] for image in images]
