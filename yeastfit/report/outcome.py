"""What became of each micrograph that was to be measured, as tables and pages show it."""

from dataclasses import dataclass
from typing import Any

from yeastfit.measure.outlining.doubts import to_be_checked
from yeastfit.measure.reading.batch_inputs import InputImage


@dataclass(frozen=True)
class Outcome:
    """The measurement of one micrograph, or why there is none.

    Attributes:
        image: What was to be measured.
        row: Numbers by column; None where the file could not be measured.
        doubts: Names of the warnings about the outline.
        error: Why there is no row; empty where there is one.
        thumbnail: A JPEG with the outline; empty where the image could not be outlined.
        sha256: Of the file; empty where it could not be read.
        ready_made: Whether the outline was given, by a file of its own or as a mask.
    """

    image: InputImage
    row: dict[str, Any] | None = None
    doubts: tuple[str, ...] = ()
    error: str = ""
    thumbnail: bytes = b""
    sha256: str = ""
    ready_made: bool = False

    @property
    def in_doubt(self) -> tuple[str, ...]:
        """Doubts that somebody should check; that an outline was corrected by hand is none."""
        return to_be_checked(self.doubts)
