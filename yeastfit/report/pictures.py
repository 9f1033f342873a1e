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
    return {name.replace("_", " "): _said(value) for name, value in settings.items() if value not in (None, {}, (), [])}


def _said(value: object) -> str:
    """One setting: lists and tables with commas, a rule by its name with its settings in brackets."""
    if isinstance(value, Mapping):
        rest = ", ".join(f"{name} {_said(one)}" for name, one in value.items() if name != "rule")
        return f"{value['rule']} ({rest})" if "rule" in value and rest else str(value.get("rule", rest))
    return ", ".join(map(_said, value)) if isinstance(value, list | tuple) else str(value)
