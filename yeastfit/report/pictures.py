"""What pages of results share: pictures of their folder, and settings in words."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from yeastfit.report import html as page


def figures(folder: Path, words: Mapping[str, str], *names: str) -> str:
    """Show those pictures that are there, each with its words.

    Arguments:
        folder: Where they are, as NAME.png.
        words: What each shows, by name.
        names: Which, in order.

    Returns:
        HTML.
    """
    there = [(name, folder / f"{name}.png") for name in names if (folder / f"{name}.png").is_file()]
    return "".join(page.card(name, path.read_bytes(), words[name], page.text(words[name])) for name, path in there)


def as_words(settings: Mapping[str, Any]) -> dict[str, str]:
    """Settings for the last section, without empty ones."""
    return {name.replace("_", " "): str(value) for name, value in settings.items() if value not in (None, {}, (), [])}
