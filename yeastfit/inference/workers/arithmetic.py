"""What decides over the last bits of a simulation: versions of libraries, the device, the threads of XLA's pool.

Colonies are chaotic: another order of summation makes another colony of the same parameters and seed within some
hundred steps. So arithmetic is compared by what it computes, bit by bit, on blocks that both sides simulate; versions
and devices say why it differs.
"""

import os
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from yeastfit.processors import available_processors

PACKAGES = ("yeastfit", "jax", "jaxlib", "numpy", "scipy", "scikit-image", "equinox", "numba")
CPUINFO = Path("/proc/cpuinfo")


@dataclass(frozen=True)
class Arithmetic:
    """Of one process.

    Attributes:
        platform: Of jax: cpu, gpu, …
        device: What jax calls it.
        devices: How many jax has here.
        processor: Its model, where the system tells.
        threads: Of XLA's pool.
        double: Whether jax computes in double precision.
        versions: Of packages, by name; those that are installed.
    """

    platform: str
    device: str
    devices: int
    processor: str
    threads: int
    double: bool
    versions: Mapping[str, str]

    @staticmethod
    def of_this_process() -> "Arithmetic":
        """As it is now; starts jax."""
        import jax

        first = jax.local_devices()[0]
        return Arithmetic(
            first.platform,
            first.device_kind,
            jax.local_device_count(),
            _processor(),
            xla_threads(),
            bool(jax.config.read("jax_enable_x64")),
            _versions(),
        )

    def asdict(self) -> dict[str, Any]:
        """Plain data."""
        return {**asdict(self), "versions": dict(self.versions)}

    def differences(self, other: "Arithmetic") -> list[str]:
        """What makes another process unlike this one, in words; the processor's model alone does not."""
        found = [
            f"{what} {mine} instead of {theirs}"
            for what, mine, theirs in (
                ("platform", other.platform, self.platform),
                ("device", other.device, self.device),
                ("threads of XLA", other.threads, self.threads),
                ("double precision", other.double, self.double),
            )
            if mine != theirs
        ]
        names = sorted({*self.versions, *other.versions})
        pairs = [(name, other.versions.get(name, "none"), self.versions.get(name, "none")) for name in names]
        return found + [f"{name} {mine} instead of {theirs}" for name, mine, theirs in pairs if mine != theirs]


def xla_threads() -> int:
    """Threads of the pool of XLA's CPU client: processors that may be used, or NPROC, and at least one a device."""
    import jax

    given = os.environ.get("NPROC", "")
    allowed = int(given) if given.isdecimal() and int(given) > 0 else available_processors()
    devices = jax.local_device_count() if jax.default_backend() == "cpu" else 1
    return max(allowed, devices)


def first_difference(mine: np.ndarray, other: np.ndarray) -> str:
    """Where two blocks of rows differ in a bit, in words; empty where they do not."""
    if mine.shape != other.shape:
        return f"rows of {other.shape[1:]} statistics instead of {mine.shape[1:]}"
    unlike = mine.view(np.uint64) != other.view(np.uint64)
    if not unlike.any():
        return ""
    row, column = np.argwhere(unlike)[0]
    return f"{other[row, column]!r} instead of {mine[row, column]!r} in statistic {column + 1} of row {row + 1}"


def _versions() -> dict[str, str]:
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _processor() -> str:
    if CPUINFO.is_file():
        for line in CPUINFO.read_text(errors="replace").splitlines():
            if line.startswith(("model name", "CPU part")):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
