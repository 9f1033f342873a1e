"""Nitrogen and carbon: does a dish that runs out of nitrogen make the disc with hairs that photographs show?

Filamentous colonies of Li et al. 2024 grew on 50 or 500 µM ammonium sulphate: nitrogen runs out, carbon does not, and
the colonies with less nitrogen are the more filamentous. Here colonies of long, mobile cells (λ = 0.1, 5, 5, 0.5, 6, 1,
0.4) grow by the scarcer of carbon, which a reservoir supplies, and nitrogen, of which a dish holds an amount ν; hard
rules, h = 0.2, Δt = 0.02. Every birth takes its nitrogen, q_N = 150, from the dish, and nothing else uses any; nodes
drift along carbon alone. c0 is 10 µM of ammonium, below which growth slows, so that ν = 10 and 100 are 50 and 500 µM
ammonium sulphate; q_N is the nitrogen of three cells above one another on agar 4 mm deep (where the numbers come from
stands in `yeastfit/model/mechanisms/nitrogen_medium.py`). Dishes of three sizes, the part of a real one that a colony
has for itself, hold ν = 10, 30 and 100, with eight colonies each: the smallest makes colonies of some hundred to some
thousand cells, the largest colonies of 5500 to 55 000 cells, as many as real ones have. Compactness C, the filament
area index I_F and the filament radius index I_R are taken on the mask at eight times, with pixels of 0.2 L0, which is
the resolution of the photographs.

Colonies of open branches may be as dense in their middle as a disc filled at random, and r_CSR, the radius of the ring
that is nearest to that, is there and not at the rim. I_F is above 1 then, beyond r_CSR lie more than 65 % of the
pixels, and neither it nor I_R says anything of filaments. Such colonies are left out for these two indices and counted.

A statement holds where the 95 % confidence interval of the difference of two means (Welch's t) lies on its side of 0,
it does not where it lies on the other, and is not resolved otherwise.

    python -m benchmarks.nitrogen [--quick] [--json FILE] [--docs DIR] [--work DIR] [--sizes small,middle,real]

Finished colonies are kept in the folder given by --work, out/nitrogen by default; an interrupted run continues there.
The page is written of those that are finished, and says which are not; --sizes none only writes it. --quick: two
colonies of two amounts in a tiny dish. --docs writes DIR/nitrogen.md and DIR/nitrogen.png.
"""

import argparse
from pathlib import Path

import jax
import numpy as np

from benchmarks.nitrogen_colonies import AMOUNTS, DISHES, MEMBERS, QUICK, Dish, Study
from benchmarks.nitrogen_page import answer, picture, statements, summary
from benchmarks.report import Report, command
from yeastfit import InputError


def study_of(quick: bool, work: Path, sizes: str) -> tuple[Study, tuple[Dish, ...]]:
    """The study, and which of its dishes are to be grown."""
    if quick:
        study = Study(QUICK, AMOUNTS[::2], 2, work / "quick")
        return study, QUICK
    wanted = [] if sizes == "none" else sizes.split(",")
    names = [dish.name for dish in DISHES]
    if not set(wanted) <= set(names):
        raise InputError(f"--sizes is {sizes!r}, it must be none or some of {','.join(names)}")
    return Study(DISHES, AMOUNTS, MEMBERS, work / "full"), tuple(dish for dish in DISHES if dish.name in wanted)


def investigate(report: Report, study: Study, wanted: tuple[Dish, ...]) -> None:
    """Grow what is missing, one member of all amounts after the other, and report on all."""
    study.work.mkdir(parents=True, exist_ok=True)
    for dish in wanted:
        for member in range(study.members):
            for amount in study.amounts:
                if (dish.name, amount, member) not in study.done:
                    report.stage(f"{dish.name} dish, nitrogen {amount:g}: colony {member + 1} of {study.members}")
                    study.grow(dish, amount, member)
        jax.clear_caches()
    rows = summary(study)
    missing = len(study.dishes) * len(study.amounts) * study.members - len(study.done)
    report.add("colonies that are not grown yet", missing, "", note=f"of {missing + len(study.done)}")
    for dish in study.dishes:
        if of := [record for key, record in study.done.items() if key[0] == dish.name]:
            seconds = np.median([record["processor seconds"] for record in of])
            report.add(f"a colony in the {dish.name} dish, median", seconds, "processor s", note=f"{len(of)} colonies")
    if rows:
        report.table("against nitrogen, at the end: mean ± standard deviation", rows)
    if found := [row for dish in study.dishes for row in statements(study, dish)]:
        report.table("what holds", found)
    if report.docs is not None and rows:
        report.docs.mkdir(parents=True, exist_ok=True)
        picture(study, report.docs / "nitrogen.png")
        page = [
            report.head(__doc__),
            answer(study),
            "![Colonies, and indices against nitrogen](nitrogen.png)",
            *report.sections(),
        ]
        (report.docs / "nitrogen.md").write_text("\n\n".join(page))


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--work", type=Path, default=Path("out/nitrogen"))
    parser.add_argument("--sizes", default=",".join(dish.name for dish in DISHES))
    own, others = parser.parse_known_args(arguments)

    def run(report: Report, quick: bool) -> None:
        investigate(report, *study_of(quick, own.work, own.sizes))

    command("nitrogen", run, others)


if __name__ == "__main__":
    main()
