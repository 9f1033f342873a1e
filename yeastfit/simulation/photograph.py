"""Bright-field photographs of simulated colonies. Not differentiable.

`photograph` turns what each pixel holds (`coverage`) into grey values, `write_micrograph` these into a file that states
its pixel size. The light that a pixel passes is

    T = 1 - φ + φ exp(-a),    a = (base + depth t + rim max(1 - t, 0)) (1 + ε),    t = thickness / φ

with φ its covered part, t the mean number of cell layers there and ε a smooth random field: Beer-Lambert, with a rim
for the light that the steep flank of a single cell bends out of the objective and a texture for what cells contain.
Within a pixel light adds; absorbance does not. The photograph is

    I = round(D · (G * (L T)) + noise),    L = background (1 + ½ gradient s - curvature d²), scaled to its mean

with G a Gaussian blur, D dust, s = x cos α + y sin α and d the distance from the lamp's centre, lengths in half sides
of the image; α and that centre, within 0.3 of the image's, are random.

Blur moves the level of half contrast inwards on a curved edge, where the contrast is flat by π σ² for a whole outline:
4 % of a cell of 10 by 7 px at σ = 0.9 px. The rim offsets most of that, as the dark outline of a real cell does: at
0.75 µm per pixel, half the median contrast 2 to 4 px inside a mask gives its area with a bias of -2 % for a cell of
7.5 by 5.4 µm (100 pictures, deviation 3 %, most of it the mask's own pixels), 0 to 1.5 % for colonies of 30 to 100.

Background, unevenness, noise and dust follow the photographs of Li et al. 2024 (off-lattice model of filamentous
yeast), taken at 1.55 µm per pixel; contrast and blur are those of a stronger objective, which shows single cells.
"""

import hashlib
import uuid
from dataclasses import dataclass
from io import BytesIO
from math import isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from yeastfit.errors import InputError
from yeastfit.simulation.cell_coverage import Array, Floats, finite, require_positive
from yeastfit.storage import written_whole
from yeastfit.text import quoted

Pixels = npt.NDArray[np.uint8]

KINDS = ("tiff", "imagej", "ome")
CLEARANCE = 4.0  # px between a speck of dust and the colony
LAMP = 0.3  # half sides: how far the lamp's centre may lie from the image's, along x and y


@dataclass(frozen=True)
class Optics:
    """Light, lens, sensor and dust, as in the module's equations; plausible ranges in brackets.

    Attributes:
        background: Mean grey level of an empty field, of 255 (120 to 200).
        gradient: Relative change of the light from one side of the image to the other (0 to 0.1).
        curvature: Relative fall of the light at half a side from the lamp's centre (0 to 0.05).
        blur: Standard deviation of the blur in µm (0.3 to 1.5).
        base: Absorbance wherever there is a cell, natural logarithm (0.2 to 0.8).
        depth: Further absorbance of every cell layer (0 to 0.3).
        rim: Further absorbance of a single cell's flanks, at its edge (0 to 0.3).
        texture: Relative standard deviation of the absorbance inside cells, whose cytoplasm is granular (0 to 0.3).
        grain: Width of the grains, the standard deviation of a Gaussian, in µm (0.3 to 1.5).
        noise: Standard deviation of a pixel in grey levels (1 to 4).
        specks: Mean number of specks of dust in an image, Poisson (0 to 4); none touches the colony.
        speck_radius: Smallest and largest radius of a speck in µm (0.5 to 2).
        speck_darkness: Smallest and largest share of the light that a speck's centre takes (0.05 to 0.5).

    Raises:
        InputError: A value is not finite or negative, or a range does not rise.
    """

    background: float = 155.0
    gradient: float = 0.06
    curvature: float = 0.03
    blur: float = 0.65
    base: float = 0.42
    depth: float = 0.12
    rim: float = 0.2
    texture: float = 0.12
    grain: float = 0.6
    noise: float = 2.5
    specks: float = 3.0
    speck_radius: tuple[float, float] = (0.7, 1.4)
    speck_darkness: tuple[float, float] = (0.1, 0.35)

    def __post_init__(self) -> None:
        largest = {"background": 255.0, "gradient": 0.5, "curvature": 0.1, "speck_darkness": 1.0}
        largest |= {"blur": 100.0, "grain": 100.0, "specks": 1000.0, "speck_radius": 100.0}  # of what an image takes
        largest |= {"base": 100.0, "depth": 100.0, "rim": 100.0, "texture": 10.0, "noise": 255.0}  # black, or noise
        for name, value in vars(self).items():
            limit = largest.get(name, float("inf"))
            pair = name.startswith("speck_")
            bounds = value if isinstance(value, tuple) else (value,)
            numbers = len(bounds) == 1 + pair and all(isinstance(each, int | float) for each in bounds)
            if not (numbers and all(map(isfinite, bounds)) and 0 <= bounds[0] <= bounds[-1] <= limit):
                what = "smallest and largest" if pair else "a number"
                upper = f" and at most {limit:g}" if isfinite(limit) else ""
                raise InputError(f"optics {name}: got {quoted(value)}, need {what}, finite, at least 0{upper}")


DEFAULT = Optics()


def photograph(
    fraction: Array, thickness: Array, pixel_size: float, rng: np.random.Generator, optics: Optics = DEFAULT
) -> Pixels:
    """The 8-bit photograph I [rows, columns] of a `coverage`: the module docstring has the equations.

    pixel_size is in µm. The same state of `rng` gives the same picture: light, texture, noise and dust are drawn from
    it in this order, so leaving out dust changes nothing else. Raises `InputError` for a fraction outside [0, 1], a
    negative thickness, shapes that differ, or NaN.
    """
    require_positive("pixel_size", pixel_size)
    fraction = finite("fraction", fraction, (None, None))
    thickness = finite("thickness", thickness, fraction.shape)
    if fraction.min() < 0 or fraction.max() > 1:
        raise InputError(f"fraction: got {fraction.min():g} to {fraction.max():g}, need values from 0 to 1")
    if thickness.min() < 0:
        raise InputError(f"thickness: got {thickness.min():g}, need layers of at least 0")
    light = _light(fraction.shape, rng, optics)
    light *= _transmitted(fraction, thickness, _texture(fraction.shape, pixel_size, rng, optics), optics)
    image = scipy.ndimage.gaussian_filter(light, optics.blur / pixel_size, mode="nearest")
    noise = optics.noise * rng.standard_normal(image.shape)
    image = image * _dust(fraction, pixel_size, rng, optics) + noise
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _texture(shape: tuple[int, ...], pixel_size: float, rng: np.random.Generator, optics: Optics) -> Floats:
    """1 + ε of the module docstring, at least 0."""
    width = optics.grain / pixel_size
    grains = scipy.ndimage.gaussian_filter(rng.standard_normal(shape), width, mode="wrap")
    return np.asarray(np.maximum(1 + optics.texture * grains / max(grains.std(), 1e-12), 0))


def _transmitted(fraction: Floats, thickness: Floats, texture: Floats, optics: Optics) -> Floats:
    """T of the module docstring."""
    layers = np.divide(thickness, fraction, out=np.zeros_like(fraction), where=fraction > 0)
    absorbance = optics.base + optics.depth * layers + optics.rim * np.maximum(1 - layers, 0)
    return np.asarray(1 - fraction + fraction * np.exp(-absorbance * texture))


def _light(shape: tuple[int, ...], rng: np.random.Generator, optics: Optics) -> Floats:
    """L of the module docstring."""
    angle = rng.uniform(0, 2 * pi)
    lamp_x, lamp_y = rng.uniform(-LAMP, LAMP, 2)
    rows, columns = ((2 * np.arange(size) + 1 - size) / max(shape) for size in shape)
    x, y = columns[None, :], rows[:, None]
    tilt = 0.5 * optics.gradient * (x * np.cos(angle) + y * np.sin(angle))
    light = 1 + tilt - optics.curvature * ((x - lamp_x) ** 2 + (y - lamp_y) ** 2)
    return np.asarray(optics.background * light / light.mean())


def _dust(fraction: Floats, pixel_size: float, rng: np.random.Generator, optics: Optics) -> Floats:
    """The light D that specks pass. Each lies in the image, `CLEARANCE` from the colony, or is left out for no room."""
    passed = np.ones(fraction.shape)
    down, right = (np.minimum(np.arange(size), np.arange(size)[::-1]) for size in fraction.shape)
    border = 1 + np.minimum(down[:, None], right[None, :])
    free = scipy.ndimage.distance_transform_edt(fraction == 0) if fraction.any() else np.full(fraction.shape, np.inf)
    for _ in range(rng.poisson(optics.specks)):
        radius = rng.uniform(*optics.speck_radius) / pixel_size
        darkness = rng.uniform(*optics.speck_darkness)
        angle, flatness, pick = rng.uniform((0, 0.6, 0), (pi, 1, 1))
        places = np.flatnonzero((free > 2 * radius + CLEARANCE) & (border > 2 * radius))
        if places.size and radius:
            row, column = divmod(int(places[int(pick * places.size)]), fraction.shape[1])
            passed *= _speck(fraction.shape, row, column, angle, radius, flatness, darkness)
    return passed


def _speck(
    shape: tuple[int, ...], row: int, column: int, angle: float, radius: float, flatness: float, darkness: float
) -> Floats:
    """1 - darkness exp(-d⁴), 1 from d = 2 on: d the distance in radii (px), which are shorter by flatness across."""
    down, right = np.arange(shape[0])[:, None] - row, np.arange(shape[1])[None, :] - column
    along, across = right * np.cos(angle) + down * np.sin(angle), down * np.cos(angle) - right * np.sin(angle)
    distance = np.hypot(along, across / flatness) / radius
    return np.asarray(1 - np.where(distance < 2, darkness * np.exp(-(np.minimum(distance, 2) ** 4)), 0))


def write_micrograph(path: str | Path, pixels: Array, pixel_size: float, kind: str = "tiff") -> None:
    """Write an image as a TIFF file that states its pixel size.

    The file appears whole or not at all and replaces one of that name. The same image makes the same bytes.

    Arguments:
        path: The file; its folder exists.
        pixels: 8 bits [rows, columns].
        pixel_size: In µm.
        kind: How the size is stated: "tiff", as pixels per centimetre, deflated; "imagej", in ImageJ's way; "ome", as
            PhysicalSizeX and PhysicalSizeY in OME-XML, deflated.

    Raises:
        InputError: The kind is another one, pixels are no such image, or the folder is missing.
    """
    path = Path(path)
    require_positive("pixel_size", pixel_size)
    if kind not in KINDS:
        raise InputError(f"kind: got {kind!r}, need one of {', '.join(KINDS)}")
    if pixels.dtype != np.uint8 or pixels.ndim != 2 or not pixels.size:
        raise InputError(f"pixels: got shape {list(pixels.shape)} of {pixels.dtype}, need uint8 [rows, columns]")
    if not path.parent.is_dir():
        raise InputError(f"{path}: {path.parent} is no folder, need one that exists")
    with written_whole(path) as temporary:
        temporary.write_bytes(_encoded(pixels, pixel_size, kind))


def _encoded(pixels: Array, pixel_size: float, kind: str) -> bytes:
    import tifffile

    options: dict[str, Any] = {"photometric": "minisblack", "software": "yeastfit"}
    if kind == "tiff":
        per_centimetre = 1e4 / pixel_size
        options |= {"resolution": (per_centimetre, per_centimetre), "resolutionunit": "CENTIMETER", "metadata": None}
    elif kind == "imagej":
        options |= {"resolution": (1 / pixel_size, 1 / pixel_size), "metadata": {"unit": "micron", "axes": "YX"}}
    else:
        # tifffile's identifier would be random; one made from the image is as unique
        digest = hashlib.sha256(pixels.tobytes() + repr((pixels.shape, pixel_size)).encode()).hexdigest()
        identifier = uuid.uuid5(uuid.NAMESPACE_OID, digest)
        sizes = {"PhysicalSizeX": pixel_size, "PhysicalSizeY": pixel_size}
        units = {"PhysicalSizeXUnit": "µm", "PhysicalSizeYUnit": "µm"}
        options["metadata"] = {"axes": "YX", "UUID": f"urn:uuid:{identifier}", **sizes, **units}
    if kind != "imagej":
        options["compression"] = "zlib"
    buffer = BytesIO()
    with tifffile.TiffWriter(buffer, imagej=kind == "imagej", ome=kind == "ome") as writer:
        writer.write(pixels, **options)
    return buffer.getvalue()
