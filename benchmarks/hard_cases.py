"""Photographs that are hard to segment, drawn from a mask, for problems that nine real photographs do not show.

`CASES` lists them. Each case takes a mask, draws its colony with the look of the real ones (contrast against depth in
grey levels of 8 bits, medians over nine photographs: 25 to 45 at the edge of a filament, five times that in the core),
and changes one thing: light, frame, noise, or other objects in the picture. `drawn_colony` makes masks where there are
no real ones.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, pi, sin

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy import ndimage

Mask = Bool[np.ndarray, "row column"]
Field = Float[np.ndarray, "row column"]
Pixels = UInt8[np.ndarray, "row column"]

DEPTH = (0.0, 4.0, 12.0, 24.0, 48.0, 100.0)  # px inside the colony
DARKER = (1.0, 1.0, 1.4, 2.0, 3.2, 5.0)  # times the contrast of a filament
LIGHT = 165.0  # grey level of the background


@dataclass(frozen=True)
class Look:
    """What a case changes.

    Attributes:
        contrast: Of a filament, in grey levels.
        noise: In grey levels.
        blur: In pixels.
        texture: Relative to the contrast.
        light: Maps x and y in [-1, 1] along the longer side of the image to brightness relative to `LIGHT`.
        objects: Draws other objects: their absorbance from a random generator and the mask.
        frame: Width of a black border in pixels.
    """

    contrast: float = 30.0
    noise: float = 2.5
    blur: float = 0.8
    texture: float = 0.2
    light: Callable[[Field, Field], Field] = lambda x, y: 1 - 0.03 * x - 0.02 * y * y
    objects: Callable[[np.random.Generator, Mask], Field] | None = None
    frame: int = 0


def drawn_colony(rng: np.random.Generator, shape: tuple[int, int], radius: float, filaments: int = 40) -> Mask:
    """A disc with branched filaments, 5 to 8 px wide, that wander outwards for about half its radius."""
    rows, columns = shape
    y, x = np.ogrid[:rows, :columns]
    mask = np.hypot(x - columns / 2, y - rows / 2) < radius
    tips = [(columns / 2, rows / 2, angle, 0.9 * radius) for angle in rng.uniform(0, 2 * pi, filaments)]
    paths = np.ones(shape, dtype=bool)
    while tips:
        px, py, angle, skip = tips.pop()
        px, py = px + skip * cos(angle), py + skip * sin(angle)
        for _ in range(int(rng.uniform(0.2, 0.6) * radius)):
            angle += 0.15 * rng.standard_normal()
            px, py = px + cos(angle), py + sin(angle)
            if not (6 < px < columns - 7 and 6 < py < rows - 7):
                break
            paths[int(py), int(px)] = False
            if rng.random() < 1.5 / radius and len(tips) < 200:
                tips.append((px, py, angle + rng.choice([-0.7, 0.7]), 0.0))
    width = 2.5 + 1.5 * _smooth_field(rng, shape, 20)
    return mask | (ndimage.distance_transform_edt(paths) < width)


def photograph(rng: np.random.Generator, mask: Mask, look: Look) -> Pixels:
    """The 8-bit photograph of a mask: I = L exp(−a), blurred and noisy; a from contrast, depth, texture and objects."""
    depth = np.interp(ndimage.distance_transform_edt(mask), DEPTH, DARKER)
    contrast = mask * look.contrast * (depth + look.texture * _smooth_field(rng, mask.shape, 2.5))
    passed = 1 - np.clip(contrast / LIGHT, 0, 0.93)
    if look.objects is not None:
        passed = passed * np.exp(-look.objects(rng, mask))
    y, x = _axes(mask.shape)
    image = LIGHT * look.light(x, y) * ndimage.gaussian_filter(passed, look.blur, mode="nearest")
    image += look.noise * rng.standard_normal(mask.shape)
    if look.frame:
        image[: look.frame], image[:, -2 * look.frame :] = 0, 0
        image[-look.frame // 2 :, : mask.shape[1] // 3] = 0
    return np.rint(image).clip(0, 255).astype(np.uint8)


def _axes(shape: tuple[int, ...]) -> tuple[Field, Field]:
    y, x = ((2 * np.arange(size) - size + 1) / max(shape) for size in shape)
    row, column = np.meshgrid(y, x, indexing="ij")
    return row, column


def _smooth_field(rng: np.random.Generator, shape: tuple[int, ...], scale: float) -> Field:
    """A random field of mean 0 and standard deviation 1."""
    field = ndimage.gaussian_filter(rng.standard_normal(shape), scale, mode="wrap")
    return np.asarray(field / field.std())


def _tiles(x: Field, y: Field) -> Field:
    """3 by 2 stitched tiles, darker towards their own edges, that differ by a few per cent."""
    steps = np.array([[1.0, 0.96, 1.02], [0.97, 1.03, 0.98]])
    column, row = np.minimum(1.5 * (x + 1), 2.999), np.minimum((y / max(1e-9, y.max()) + 1), 1.999)
    shade = 1 - 0.04 * ((column % 1 - 0.5) ** 2 + (row % 1 - 0.5) ** 2)
    return np.asarray(steps[row.astype(int), column.astype(int)] * shade)


def _blob(rng: np.random.Generator, shape: tuple[int, ...], x: float, y: float, size: float) -> Field:
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    wobble = 0.25 * size * _smooth_field(rng, shape, size / 2)
    return 1.5 * (np.hypot(columns - x, rows - y) + wobble < size)


def _at_corner(rng: np.random.Generator, mask: Mask) -> Field:
    """A dark object that fills a corner without touching the colony."""
    distance = ndimage.distance_transform_edt(~mask)
    return _blob(rng, mask.shape, 0, 0, 0.45 * distance[0, 0])


def _touching(rng: np.random.Generator, mask: Mask) -> Field:
    """A dark object from the left that ends 3 px inside the colony's leftmost point."""
    rows, columns = np.nonzero(mask)
    first = int(columns.argmin())
    reach, row = columns[first] + 3, rows[first]
    y, x = np.ogrid[: mask.shape[0], : mask.shape[1]]
    width = 0.12 * mask.shape[0]
    return 1.5 * ((((x / reach) ** 2 + ((y - row) / width) ** 2) < 1) & ~(mask & (x > reach)))


def _free(rng: np.random.Generator, mask: Mask) -> Field:
    """A dark object in the widest gap between colony and border."""
    distance = ndimage.distance_transform_edt(np.pad(~mask, 1))[1:-1, 1:-1]
    row, column = np.unravel_index(distance.argmax(), mask.shape)
    return _blob(rng, mask.shape, float(column), float(row), 0.4 * distance.max())


def _fibre(rng: np.random.Generator, mask: Mask) -> Field:
    """A thin dark fibre across the background, from border to border, that does not touch the colony."""
    distance = ndimage.distance_transform_edt(~mask)
    y, x = np.ogrid[: mask.shape[0], : mask.shape[1]]
    corner = 0.55 * distance[-1, -1] * 1.4
    return 0.7 * (np.abs((mask.shape[1] - x) + (mask.shape[0] - y) - corner) < 3)


def _dust(rng: np.random.Generator, mask: Mask) -> Field:
    """Sixty specks with a radius of 1 to 3 px that do not touch the colony."""
    free = np.argwhere(ndimage.distance_transform_edt(~mask) > 8)
    centres = np.ones(mask.shape, dtype=bool)
    chosen = free[rng.integers(len(free), size=60)]
    centres[chosen[:, 0], chosen[:, 1]] = False
    return 0.8 * (ndimage.distance_transform_edt(centres) < 2 + _smooth_field(rng, mask.shape, 10).clip(-1, 1))


def _shadow(rng: np.random.Generator, mask: Mask) -> Field:
    """A soft shadow, 12 % deep, beside the colony and partly under it."""
    y, x = _axes(mask.shape)
    return 0.12 * np.exp(-(((x - 0.5) / 0.3) ** 2) - ((y + 0.2) / 0.3) ** 2)


PLAIN = Look()
CASES: dict[str, Look] = {
    "plain": PLAIN,
    "light falls off to one side": replace(PLAIN, light=lambda x, y: 0.7 + 0.3 * x),
    "light falls off at one side": replace(PLAIN, light=lambda x, y: 1 / (1 + np.exp(-(x + 0.8) / 0.08)) * 0.6 + 0.4),
    "light falls off into a corner": replace(PLAIN, light=lambda x, y: 1 - 0.16 * (x + y + 0.5).clip(0) ** 2),
    "light falls off all round": replace(PLAIN, light=lambda x, y: 1 - 0.45 * (x * x + y * y)),
    "tiles": replace(PLAIN, light=_tiles),
    "black frame": replace(PLAIN, frame=12),
    "frame and falling light": replace(PLAIN, frame=12, light=lambda x, y: 0.75 + 0.25 * y),
    "bright in the middle": replace(
        PLAIN, light=lambda x, y: 0.7 + 0.3 * np.exp(-(((x + 0.4) / 0.5) ** 2) - ((y + 0.2) / 0.5) ** 2)
    ),
    "a darker band": replace(PLAIN, light=lambda x, y: 1 - 0.2 / (1 + np.exp(-(y - 0.5) / 0.02))),
    "a sharp band": replace(PLAIN, light=lambda x, y: 1 - 0.12 * (y > 0.45)),
    "stripes": replace(PLAIN, light=lambda x, y: 1 + 0.01 * np.sign(np.sin(90 * y))),
    "shadow": replace(PLAIN, objects=_shadow),
    "small shadow": replace(
        PLAIN, light=lambda x, y: 1 - 0.12 * np.exp(-(((x - 0.5) / 0.15) ** 2) - ((y + 0.2) / 0.15) ** 2)
    ),
    "faint": replace(PLAIN, contrast=12.0),
    "noise": replace(PLAIN, noise=6.0),
    "coarse texture": replace(PLAIN, texture=0.35),
    "blur": replace(PLAIN, blur=1.6),
    "dust": replace(PLAIN, objects=_dust),
    "object in a corner": replace(PLAIN, objects=_at_corner),
    "object touching the colony": replace(PLAIN, objects=_touching),
    "object by itself": replace(PLAIN, objects=_free),
    "fibre": replace(PLAIN, objects=_fibre),
}
