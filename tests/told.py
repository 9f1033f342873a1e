"""What commands say, and what they write of themselves."""

import json
from pathlib import Path

import pytest

from yeastfit.commands import app as cli


def configuration(folder: Path) -> dict[str, object]:
    return json.loads((folder / "manifest.json").read_text())["configuration"]


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line of an error."""
    capsys.readouterr()
    assert cli.run(list(arguments)) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line
