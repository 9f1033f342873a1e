"""What commands need to know of simulated colonies: curves, pictures and masks, whatever model they come from."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from yeastfit.panel import Panel

Outlines = tuple[list[Bool[np.ndarray, "x y"]], float]
"""Masks of simulated colonies, and µm per pixel."""


@runtime_checkable
class Grown(Protocol):
    """Simulated colonies as `yeastfit simulate` writes and draws them."""

    @property
    def statistics(self) -> Mapping[str, np.ndarray]:
        """By name, members first, then samples."""

    @property
    def clock(self) -> Float[np.ndarray, " sample"]:
        """When the samples were taken."""

    @property
    def clock_label(self) -> str:
        """What `clock` counts."""

    @property
    def length_unit(self) -> str:
        """Of the statistics."""

    @property
    def seconds(self) -> float:
        """What it took."""

    def rows(self) -> list[dict[str, Any]]:
        """Tidy table: one row per member and sample."""

    def panels(self, member: int) -> list[Panel]:
        """What a picture of one colony at its end shows, at least one panel."""

    def masks(self) -> Outlines | None:
        """Of all members at their end, as a camera would see them, with µm per pixel; None where there are none."""

    def warnings(self) -> list[str]:
        """What is to be doubted, in words."""

    def sentence(self) -> str:
        """What has been grown, in words."""

    def save(self, path: str | Path) -> None:
        """Save everything as a NumPy archive."""
