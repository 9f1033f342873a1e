"""How colonies of the off-lattice model are drawn to be compared: as which masks, on which pixels, how closed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from yeastfit.errors import InputError
from yeastfit.inference.models.image_checks import check_pixel
from yeastfit.offlattice.parameters import DRAWING

COMPARABLE = ("li2024_filament_area_index", "li2024_filament_radius_index", "smoothed_branch_index", "angular_index")
"""What photographs and simulations are compared in: I_F, I_R, I_B of smoothed outlines, and the angular index.

Photographing a mask leaves them alone. Without the last a posterior may be of colonies of a few tufts.
"""
TEXTURE = (
    "filament_area_index",
    "filament_radius_index",
    "angular_index",
    "solidity",
    "inscribed_radius",
    "smoothed_compactness",
    "smoothed_branch_length",
    "smoothed_branch_count",
    "smoothed_filament_width",
)
"""Shape, how round a core is and how free of holes, and texture of outlines that are smoothed.

Simulated colonies that agree with real ones in these, with `margin` free, look more like them (`docs/likeness.md`).
"""
CELL_LENGTH = 8.4  # µm, of a cell in yeast form
Masks = Literal["li2024", "bins", "ellipses"]


@dataclass(frozen=True)
class Drawing:
    """Settings of `Offlattice` that decide over it.

    Attributes:
        masks: Which; None for those that the statistics ask for.
        pixel_size: µm per pixel of ellipses; None for that of the real photographs.
    """

    masks: Masks | None
    pixel_size: float | None

    def kind(self, statistics: Sequence[str]) -> Masks:
        """Masks for these statistics."""
        from yeastfit.offlattice.simulator import OF_BINS
        from yeastfit.offlattice.statistics.li2024_statistics import PUBLISHED

        if self.masks is not None:
            return self.masks
        if set(statistics) == set(PUBLISHED):
            return "li2024"
        return "bins" if {*COMPARABLE, *(entry.name for entry in OF_BINS)}.issuperset(statistics) else "ellipses"

    def unused(self, statistics: Sequence[str]) -> list[str]:
        """What is to be said of a setting of ellipses where none are drawn."""
        kind = self.kind(statistics)
        return [] if kind == "ellipses" or self.pixel_size is None else [_not_used("--pixel-size", kind)]

    def of(
        self, statistics: Sequence[str], free: Sequence[str] = (), fixed: Mapping[str, float] | None = None
    ) -> tuple[Callable[..., Any], float]:
        """What draws a colony, to be called with those of its own parameters that are free, and µm per pixel.

        Arguments:
            statistics: That are measured.
            free: Names of free parameters.
            fixed: Values of others.

        Raises:
            InputError: A gap or margin is not admissible; or is given, or free, where ellipses are not drawn.
        """
        from yeastfit.offlattice.masks.ellipse_mask import PIXEL, Ellipses
        from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
        from yeastfit.offlattice.placing import PIXELS_PER_UM

        kind = self.kind(statistics)
        given = {name: (fixed or {}).get(name, one.default) for name, one in DRAWING.items()}
        DRAWING.check(given)
        if kind == "ellipses":
            pixel = PIXEL if self.pixel_size is None else self.pixel_size
            check_pixel(pixel, CELL_LENGTH, "pixel_size")
            draw: Callable[..., Any] = Ellipses.of
            held = {name: value for name, value in given.items() if name not in free}
            return partial(draw, pixel_size=pixel, **held), pixel
        for name, one in DRAWING.items():
            if given[name] != one.default:
                raise InputError(_not_used(f"--{name}", kind))
            if name in free:
                raise InputError(
                    f"--free: {name} is that of ellipses, and masks are drawn by --masks {kind}: leave it out, or give "
                    "--masks ellipses"
                )
        return BinnedOutlines.of if kind == "li2024" else BinnedOutlines.whole, 1 / PIXELS_PER_UM


def _not_used(flag: str, kind: Masks) -> str:
    return f"{flag} is that of ellipses and not used, masks are drawn by --masks {kind}: leave it out"
