"""Text from users and files, made safe to show: for people, in messages, in HTML.

File names and names of conditions are data. What they hold must not act on a terminal or a page, end a line, or hide
what it is: control characters (newlines and escape sequences among them), directional overrides and other invisible
characters, and bytes of file names that are not UTF-8 are written as escapes. `yeastfit.plot.style.literal` does the
same for figures.
"""

import html
import unicodedata
from typing import Any

HIDDEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # Unicode categories: control, format, surrogate, separators of lines
JOINERS = "\u200c\u200d"  # which belong to emoji and to words of some scripts
LONGEST_VALUE = 80  # characters of a value that a message repeats


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


def quoted(value: Any) -> str:
    """Write a value as Python does, for a message; what is longer than `LONGEST_VALUE` is cut in the middle."""
    try:
        whole = repr(value)
    except ValueError:  # Python writes no integer of more than 4300 digits
        return "a whole number of thousands of digits"
    except RecursionError:
        return f"a {type(value).__name__} nested thousands of times"
    if len(whole) <= LONGEST_VALUE:
        return shown(whole)
    half = LONGEST_VALUE // 2 - 3
    return shown(f"{whole[:half]} ... {whole[-half:]}")


def as_html(text: object) -> str:
    """Escape any text for HTML, attributes included."""
    return html.escape(shown(text))


def _visible(character: str) -> str:
    """A character, or the escape that stands for it."""
    if unicodedata.category(character) not in HIDDEN or character in JOINERS:
        return character
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:  # a byte that is not UTF-8, as Python reads it from the system
        return f"\\x{code - 0xDC00:02x}"
    return character.encode("unicode_escape", "surrogatepass").decode()
