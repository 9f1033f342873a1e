"""Colonies of the study `nitrogen`: their dishes, how one is grown and measured, and where finished ones are kept."""

import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.lines import append_line, read_lines
from yeastfit import HARD, InputError, Model, Numerics, Parameters, Simulation, member_keys, simulate
from yeastfit.measure.statistics.model_as_mask import HardStatistics, mask_of

INDICES = {"compactness": "C", "filament_area_index": "I_F", "filament_radius_index": "I_R"}
VALUES = {"mobility": 6.0, "aspect_ratio": 0.4, "metabolic_rate": 1.0}
NITROGEN = {"nitrogen_uptake": 0.0, "nitrogen_per_birth": 150.0}
AMOUNTS, MEMBERS, PIXEL = (10.0, 30.0, 100.0), 8, 0.2
NAMES = (*INDICES, "area", "cell_count", "radius")
Record = dict[str, Any]


@dataclass(frozen=True)
class Dish:
    """One size: side in L0, when colonies are photographed, slots for nodes."""

    name: str
    side: float
    time: float
    capacity: int

    @property
    def numerics(self) -> Numerics:
        """Of its simulations."""
        return Numerics(domain=self.side, spacing=PIXEL, dt=0.02, capacity=self.capacity)


DISHES = (
    Dish("small", 64.0, 20.0, 4096),
    Dish("middle", 128.0, 30.0, 16384),
    Dish("real", 288.0, 60.0, 65536),
)
QUICK = (Dish("tiny", 16.0, 6.0, 256),)


@dataclass(frozen=True)
class Study:
    """Dishes, amounts of nitrogen and members, and the folder of finished colonies."""

    dishes: tuple[Dish, ...]
    amounts: tuple[float, ...]
    members: int
    work: Path

    @cached_property
    def done(self) -> dict[tuple[str, float, int], Record]:
        """Finished colonies. Raises `InputError` if one was grown in another dish or with other parameters."""
        records: dict[tuple[str, float, int], Record] = {}
        known = {dish.name: plain(dish) for dish in self.dishes}
        for record in read_lines(self.work / "colonies.jsonl"):
            if known.get(record["dish"]["name"]) != record["dish"] or record["values"] != VALUES | NITROGEN:
                raise InputError(
                    f"--work: {self.work} holds colonies of other dishes or parameters; name another folder"
                )
            records[record["dish"]["name"], record["amount"], record["member"]] = record
        return records

    def of(self, dish: Dish, amount: float) -> list[Record]:
        """Finished colonies of one amount in one dish."""
        return [self.done[key] for k in range(self.members) if (key := (dish.name, amount, k)) in self.done]

    def mask(self, dish: Dish, amount: float) -> Path:
        """File of the picture of the first colony."""
        return self.work / f"{dish.name}-{amount:g}.npz"

    def grow(self, dish: Dish, amount: float, member: int) -> None:
        """One colony, measured when its births have stopped and at the end, and kept."""
        began, used = time.perf_counter(), time.process_time()
        times = dish.time * np.arange(1, 9) / 8
        run = simulate(
            Parameters(**VALUES, **NITROGEN, nitrogen=amount),
            member_keys(0, self.members)[member],
            times=times,
            model=Model.of({"medium": {"rule": "nitrogen"}}),
            numerics=dish.numerics,
            relaxation=HARD,
            observe=HardStatistics(dish.side, PIXEL, NAMES),
            throw=False,  # what went wrong stands in the record
        )
        if member == 0:
            np.savez_compressed(self.mask(dish, amount), mask=_mask(run), side=dish.side)
        left = np.asarray(run.colony.medium["nitrogen"])
        record = {
            **{"dish": plain(dish), "values": VALUES | NITROGEN, "amount": amount, "member": member},
            **{"times": times.tolist(), "nitrogen left": float(left.mean()), "warnings": run.warnings()},
            **{"statistics": {name: run.statistics[name].tolist() for name in NAMES}},
            **{"seconds": time.perf_counter() - began, "processor seconds": time.process_time() - used},
        }
        append_line(self.work / "colonies.jsonl", record)
        self.done[dish.name, amount, member] = record


def plain(dish: Dish) -> Record:
    """A dish in records."""
    return {"name": dish.name, "side": dish.side, "time": dish.time, "capacity": dish.capacity}


def _mask(run: Simulation) -> np.ndarray:
    """Cells at the end, on the whole dish."""
    return mask_of(run.colony, run.parameters, run.relaxation, run.numerics.domain, 1201)
