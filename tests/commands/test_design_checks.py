"""`yeastfit design` knows before anything grows how many runs it needs."""

from dataclasses import replace
from typing import Any

import pytest
from sensitivities import made_up

from yeastfit import InputError
from yeastfit.commands.design_checks import check_freedom, check_runs
from yeastfit.inference.information.design import design
from yeastfit.inference.information.experiment import freedom_of_runs, runs_for, scatter_freedom

FREE, STATISTICS, TIMES = ("mobility", "aspect_ratio"), ("area", "radius"), [1.0, 2.0, 3.0, 4.0, 5.0]
FOUND = made_up(STATISTICS, TIMES, FREE)


@pytest.mark.parametrize(
    ("how", "means"),
    [
        ({}, 10),
        ({"measured_times": [1.0, 2.0]}, 4),
        ({"measured_times": []}, 2),
        ({"measured_times": [1.0], "measured_statistics": ["area"]}, 2),
        ({"new_replicates": False, "measured_times": [1.0], "steps": 2}, 6),
        ({"new_replicates": False, "measured_times": [1.0], "steps": 3, "by": "statistic"}, 5),
        ({"new_replicates": False, "measured_times": [], "steps": 9}, 10),
    ],
    ids=str,
)
def test_a_design_is_refused_where_its_largest_covariance_cannot_be_told(how: dict[str, Any], means: int) -> None:
    known: dict[str, Any] = {"measured_times": None, "measured_statistics": None, "new_replicates": True}
    known |= {"steps": 3, "by": "image", **how}
    enough, few = (replace(FOUND, runs={"mean": freedom + 1}) for freedom in (means + 2, means + 1))
    design(enough, **known)
    check_freedom(known, enough, "it")
    with pytest.raises(InputError, match="freedom is"):
        design(few, **known)
    with pytest.raises(InputError, match=f"^it is too few for the covariance of {means} means .* --runs "):
        check_freedom(known, few, "it is")


def test_runs_that_are_too_few_are_told_with_how_many_are_enough() -> None:
    known = {"measured_times": None, "measured_statistics": None, "new_replicates": True, "steps": 3, "by": "image"}
    times = [float(time) for time in range(1, 21)]
    with pytest.raises(InputError, match=r"^--runs is 32, .* of 40 means .*: give --runs 48 or more"):
        check_runs(known, STATISTICS, times, 32, 2)
    check_runs(known, STATISTICS, times, 48, 2)
    assert runs_for(40, 2) == 48
    made = replace(FOUND, runs={"mean": 12, "regression": 48})
    assert freedom_of_runs(48, len(FREE)) == scatter_freedom(made)
