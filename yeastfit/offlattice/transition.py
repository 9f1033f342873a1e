"""The transition from sated to pseudohyphal growth, and which form a daughter has (Li et al. 2024, see `growth`).

Of N cells, those up to number t = round(n* N), half away from zero, are sated. After that, with the u₁ by which the
mother was chosen, a daughter is

    pseudohyphal if u₁ < p_sp, else sated      of a sated mother,
    pseudohyphal                               of a pseudohyphal mother without pseudohyphal daughters,
    sated if u₁ < p_ps, else pseudohyphal      of a pseudohyphal mother with one: then a fork.

So of a pseudohyphal cell with a pseudohyphal daughter the next is sated with probability p_ps, and a fork with
(1 − p_ps) γ; with the rest another cell buds in its place, of which u₁ > p_ps is known. If that one is sated, its
daughter is pseudohyphal with probability max(0, p_sp − p_ps) / (1 − p_ps), hence never where p_sp ≤ p_ps.
"""

from yeastfit.compiled import kernel
from yeastfit.offlattice.overlap import PSEUDOHYPHAL, SATED
from yeastfit.offlattice.parameters import Rates


def last_sated(transition: float, cells: int) -> int:
    """t: the number, from 1, of the last cell that is born before the transition."""
    whole, rest = divmod(transition * cells, 1)
    return int(whole) + (rest >= 0.5)


@kernel
def daughters_form(form: int, bears: bool, u: float, rates: Rates) -> int:
    """The daughter's form by its mother's, whether that has a pseudohyphal daughter, and u₁."""
    if form == SATED:
        return PSEUDOHYPHAL if u < rates.pseudohyphal_from_sated else SATED
    return SATED if u < rates.sated_from_pseudohyphal and bears else PSEUDOHYPHAL
