"""What the site makes of docstrings and types of the package, which are written for `help()` and for type checkers."""

import ast
import re
import tomllib
import zlib
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "yeastfit"
ROOMS = {"yeastfit": PACKAGE} | {
    f"yeastfit.{name}": PACKAGE / name for name in ("measure", "model", "offlattice", "plot")
}
"""Packages that have public names, each the folder of one."""


def public_names(room: str) -> dict[str, str]:
    """Names that users import from a package, by where they are defined: as `from .targets import Targets` says."""
    stub = ROOMS[room] / "__init__.pyi"
    tree = ast.parse((stub if stub.is_file() else stub.with_suffix(".py")).read_text(encoding="utf-8"))
    found = {}
    for line in tree.body:
        if isinstance(line, ast.ImportFrom):
            start = room if line.level else ""
            module = ".".join(filter(None, (start, line.module)))
            found |= {f"{module}.{each.name}": f"{room}.{each.asname or each.name}" for each in line.names}
    return {origin: name for origin, name in found.items() if name not in ROOMS and "__future__" not in origin}


PUBLIC = {origin: name for room in reversed(ROOMS) for origin, name in public_names(room).items()}
"""Public name by the place of definition, the shortest where there are several."""
SHORT = {name.rpartition(".")[2]: name for name in PUBLIC.values()}


def _fields() -> dict[str, dict[str, str]]:
    """Types of attributes by class and name, as they are written in classes' bodies."""
    found: dict[str, dict[str, str]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for each in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(each, ast.ClassDef):
                lines = [line for line in each.body if isinstance(line, ast.AnnAssign)]
                types = {ast.unparse(line.target): ast.unparse(line.annotation) for line in lines}
                found.setdefault(each.name, {}).update(types)
    return found


FIELDS = _fields()
OTHERS = tomllib.loads((PACKAGE.parent / "docs" / "inventories.toml").read_text(encoding="utf-8"))
"""By package: its address, and names by the page that describes them."""

ELSEWHERE = {name for table in OTHERS.values() for page, names in table.items() if page != "address" for name in names}
NAME = re.compile(r"[\w.]+")


def inventories(folder: Path) -> dict[str, tuple[str, str]]:
    """Write what intersphinx reads of other packages; where their pages are, and these files."""
    folder.mkdir(parents=True, exist_ok=True)
    found = {}
    for package, table in OTHERS.items():
        pages = [(name, page) for page, names in table.items() if page != "address" for name in names]
        lines = "".join(f"{name} py:class 1 {page.replace('$', name)} -\n" for name, page in pages)
        path = folder / f"{package}.inv"
        head = (
            f"# Sphinx inventory version 2\n# Project: {package}\n# Version: \n# The rest is compressed using zlib.\n"
        )
        path.write_bytes(head.encode() + zlib.compress(lines.encode()))
        found[package] = table["address"], str(path)
    return found


def is_shown(what: str, name: str, documented: bool) -> bool:
    """Whether a name has a place on the site: public ones, and what is documented of them."""
    if what in ("module", "package"):
        return name in ROOMS
    return name in SHORT.values() or (documented and not name.rpartition(".")[2].startswith("_"))


def resolved(name: str) -> str | None:
    """Public name of what a type or a docstring refers to, by any of its names; None where it has none."""
    origin, _, rest = name, "", ""
    while origin:
        if origin in PUBLIC:
            return PUBLIC[origin] + rest
        origin, _, last = origin.rpartition(".")
        rest = f".{last}{rest}"
    first, dot, rest = name.partition(".")
    return SHORT[first] + dot + rest if first in SHORT and (first[0].isupper() or not dot) else None


def is_internal(name: str) -> bool:
    """Whether a type is one of the package that is not public, or a word of a shape."""
    return not any(f"{name}.".startswith(f"{public}.") for public in SHORT.values()) and (
        name.startswith("yeastfit.") or not re.match(r"\w+\.\w", name) or "[" in name
    )


def as_rst(what: str, name: str, lines: list[str]) -> None:
    """Make reStructuredText of the docstring of a class, function, attribute and so on, in place.

    Names in backquotes become links or code, and blocks that are indented after an empty line literal blocks. Whatever
    else reStructuredText reads as markup (|x|, *, a trailing underscore) is text in a docstring. What is said of a
    value is no type where it has a colon: one at its beginning tells Napoleon so.
    """
    if what in ("attribute", "data", "property") and lines and ":" in lines[0]:
        lines[0] = f": {lines[0]}"
    for number, line in enumerate(lines[:-1]):
        if line.strip() in ("Returns:", "Yields:"):
            lines[number + 1] = re.sub(r"^(\s*)", r"\1: ", lines[number + 1])
    made: list[str] = []
    outside: int | None = None  # indentation of the text around a literal block, within one
    above = ""  # the last line with text
    for line in lines:
        indent = len(line) - len(line.lstrip())
        if line.strip():
            if outside is not None and indent <= outside:
                outside = None
            text = len(above) - len(above.lstrip())
            if outside is None and made and not made[-1].strip() and indent >= text + 4:
                outside = text
                if not above.endswith("::"):
                    made += [f"{' ' * text}::", ""]
            above = line
        made.append(line if outside is not None else _text(line))
    lines[:] = _with_types(made, FIELDS.get(name.rpartition(".")[2], {})) if what == "class" else made


def _with_types(lines: list[str], types: dict[str, str]) -> list[str]:
    """A class's docstring with the types of the attributes that it describes."""

    def typed(found: re.Match[str]) -> str:
        text = types.get(found[1], "").replace("np.", "numpy.").replace("*", r"\*").strip("'\"")
        return f"    {found[1]} ({text}): " if text and "]" not in text.partition("[")[0] else found[0]

    start = next((number for number, line in enumerate(lines) if line.strip() == "Attributes:"), len(lines))
    return lines[:start] + [re.sub(r"^ {4}(\w+): ", typed, line) for line in lines[start:]]


def with_shapes(annotation: str) -> str:
    """Types of arrays with their shapes in quotes, which autoapi leaves out, so that Sphinx can read them."""
    return re.sub(r"(jaxtyping\.(?!PyTree)\w+\[[\w.]+(?: \| [\w.]+)*), ?([^'\[\]]*)\]", r"\1, '\2']", annotation)


def _text(line: str) -> str:
    """A line outside of literal blocks."""
    parts = re.split(r"(``[^`]+``|`[^`]+`)", line)
    escape = re.compile(r"([*|\\]|_(?=\W|$))")
    return "".join(_code(part) if part.startswith("`") else escape.sub(r"\\\1", part) for part in parts)


def _code(quoted: str) -> str:
    """A quoted name as a link to its page, or as code."""
    text = quoted.strip("`")
    name = text.removesuffix("()")
    target = name if name in ELSEWHERE else resolved(name.removeprefix("yeastfit.")) if NAME.fullmatch(name) else None
    return f":py:obj:`{text} <{target}>`" if target else f"``{text}``"
