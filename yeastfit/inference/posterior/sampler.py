"""How methods of sampling look from outside: one class with its settings as fields, and one call."""

from typing import Protocol, runtime_checkable

from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.store.simulations import Simulations
from yeastfit.progress import Progress


@runtime_checkable
class Sampler(Protocol):
    """A method of sampling posteriors: a frozen dataclass whose fields are its settings, checked when it is made.

    Further attributes are read where they exist:

        resolved(free)         the sampler with settings that were left open (None) filled in, for so many parameters
        check(free, inferred, statistics)  raises InputError where its settings do not suit so many free parameters, so
                               many that are inferred (τ of a `Variation` besides), and so many statistics or more
        simulations_at_most    upper bound on single simulations, for progress bars
        learns                 whether it trains on all simulations that another run made (`Simulations.reused`)
        varies                 whether it knows of parameters that scatter between colonies (`Variation`)
    """

    def run(self, problem: Problem, store: Simulations, seed: int, progress: Progress) -> Posterior:
        """Sample the posterior of a problem.

        Arguments:
            problem: Simulator, prior and data.
            store: Where every simulation is kept: `CachedSimulator(problem.simulator, batch, store)` reads from there
                what it holds. So a run that was stopped is resumed by repeating it.
            seed: All random numbers come from it: same seed, same posterior.
            progress: Called with what is being done and the share that is done.

        Returns:
            Draws with their status, diagnostics and warnings (`Posterior.of`).

        Raises:
            InputError: The settings do not suit the problem.
        """
