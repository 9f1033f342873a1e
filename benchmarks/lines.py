"""Records of a study that may be interrupted: a line of JSON for each finished piece of work."""

import os
from pathlib import Path
from typing import Any

from yeastfit.storage import as_json, from_json


def read_lines(path: Path) -> list[dict[str, Any]]:
    """All records; none if there is no file. An incomplete last line is removed."""
    if not path.is_file():
        return []
    text = path.read_text()
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        path.write_text(whole)
    return [from_json(line) for line in whole.splitlines()]


def append_line(path: Path, record: dict[str, Any]) -> None:
    """Append a record and write it to disk."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as file:
        file.write(as_json(record) + "\n")
        file.flush()
        os.fsync(file.fileno())
