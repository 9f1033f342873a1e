"""Text from users and files, made safe to show: for people, in messages, in HTML.

File names and names of conditions are data. What they hold must not act on a terminal or a page, end a line, or hide
what it is: control characters (newlines and escape sequences among them), directional overrides and other invisible
characters, and bytes of file names that are not UTF-8 are written as escapes. `yeastfit.plot.style.literal` does the
same for figures.
"""

import html
import re
import unicodedata
from collections.abc import Mapping, Sequence
from datetime import date, time
from itertools import accumulate
from typing import Any

HIDDEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # Unicode categories: control, format, surrogate, separators of lines
JOINERS = "\u200c\u200d"  # which belong to emoji and to words of some scripts
NOT_IN_NAMES = '/\\<>:"|?*'  # on one system or another
LONGEST_NAME = 120  # bytes of the name of a file; systems take 255, with what is put before and behind it
LONGEST = 80  # characters of a text that a message repeats
LONGEST_LIST = 400  # of names that a message lists


def shown(text: object) -> str:
    r"""Write any text in one line that is valid UTF-8, for terminals, tables and pages.

    Arguments:
        text: Anything; its `str` is taken.

    Returns:
        The text with `\n`, `\x1b`, `\u202e` and the like for what is not to be seen; a byte of a file name that is not
        UTF-8 is `\xff`, for instance. Everything else is as it was: letters of any script, emoji, `$`, brackets.
    """
    text = str(text)
    return text if text.isascii() and text.isprintable() else "".join(map(_visible, text))


def short(text: object) -> str:
    """Like `shown`; what is longer than `LONGEST` is cut in the middle."""
    text = str(text)
    return shown(text) if len(text) <= LONGEST else shown(f"{text[: LONGEST // 2 - 2]} ... {text[3 - LONGEST // 2 :]}")


def quoted(value: Any) -> str:
    """Write a value for a message in no more than `LONGEST` characters, in the words of TOML: true, [2, 2], {a = 1}."""
    try:
        return short(_in_words_of_files(value))
    except ValueError:  # Python writes no integer of more than 4300 digits
        return "a whole number of thousands of digits"
    except RecursionError:
        return f"a {type(value).__name__} nested thousands of times"


def listed(names: Sequence[str]) -> str:
    """Names for a message, as many as fit into `LONGEST_LIST` characters, and how many more there are."""
    fit = sum(width <= LONGEST_LIST for width in accumulate(len(name) + 2 for name in names))
    more = len(names) - fit
    return ", ".join(names[:fit]) + (f" and {more} more" if more else "")


def capitalised(text: str) -> str:
    """With a capital letter first, the rest as it is."""
    return text[:1].upper() + text[1:]


def file_name(text: str) -> str:
    r"""Make a name for a file of any text: visible, without `/ \ < > : " | ? *`, of at most `LONGEST_NAME` bytes.

    Arguments:
        text: The name of another file, without suffix, for instance.

    Returns:
        The name in Unicode's composed form, with `_` for what does not belong into it. Different texts may have one
        name.
    """
    composed = unicodedata.normalize("NFC", text)
    name = "".join("_" if shown(each) != each or each in NOT_IN_NAMES else each for each in composed)
    return name.encode()[:LONGEST_NAME].decode(errors="ignore").lstrip(".- ").rstrip(". ") or "_"


def natural_order(text: str) -> list[str | int]:
    """A key to sort by, in which numbers count: s2 comes before s10."""
    return [int(part) if k % 2 else part for k, part in enumerate(re.split(r"([0-9]+)", text))]


def as_html(text: object) -> str:
    """Escape any text for HTML, attributes included."""
    return html.escape(shown(text))


def _in_words_of_files(value: Any) -> str:
    """A value as TOML and JSON write it; text in quotation marks, with escapes."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, date | time):
        return value.isoformat()
    if isinstance(value, Mapping):
        entries = ", ".join(f"{key} = {_in_words_of_files(one)}" for key, one in value.items())
        return f"{{{entries}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_in_words_of_files, value))}]"
    if hasattr(value, "__array__") and hasattr(value, "tolist"):  # of NumPy or of JAX, whose keys have none
        return re.sub(r"\.0(?=[],]|$)", "", _in_words_of_files(value.tolist()))
    return repr(value)


def _visible(character: str) -> str:
    """A character, or the escape that stands for it."""
    if unicodedata.category(character) not in HIDDEN or character in JOINERS:
        return character
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:  # a byte that is not UTF-8, as Python reads it from the system
        return f"\\x{code - 0xDC00:02x}"
    return character.encode("unicode_escape", "surrogatepass").decode()
