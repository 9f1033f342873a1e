"""What was learnt, in one sentence: of a fit, and of a posterior against its prior."""

import numpy as np

from yeastfit.inference.fit.result import Fit
from yeastfit.inference.information.identifiability import percent
from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.inference.posterior.draws import weighted_quantile
from yeastfit.inference.posterior.result import Posterior
from yeastfit.report.html import number
from yeastfit.text import capitalised

ALIKE = 0.8  # of the prior's standard deviation, from where a parameter is as uncertain as before
MOVED = 0.2  # of the prior beyond the posterior's median, below which a parameter has moved
TOGETHER = 0.8  # correlation from where two parameters are told together


def learnt_by_fit(result: Fit) -> str:
    """Say how well a fit determines each parameter, the best known first."""
    errors = result.log_standard_errors
    known = sorted((name for name in result.free if np.isfinite(errors[name])), key=lambda name: errors[name])
    unknown = [name for name in result.free if name not in known]
    parts = [f"{_words(name)} to {percent(errors[name])}" for name in known]
    said = [f"the data determine {_listed(parts)}"] if parts else []
    who = "they" if parts else "the data"
    said += [f"{who} do not determine {_listed([_words(name) for name in unknown])}"] if unknown else []
    return _sentence(said)


def learnt_by_posterior(posterior: Posterior, model: ForwardModel) -> str:
    """Say how much narrower the posterior of each parameter is than its prior, and what is told together only."""
    prior, ends = posterior.prior, posterior.interval(0.9)
    x = prior.coordinates(posterior.flat)
    weights = posterior.weights.ravel()
    before = np.array([one.density.std() for one in prior.distributions.values()])
    away = x - weights @ x
    covariance = (away * weights[:, None]).T @ away
    ratio = np.sqrt(np.diag(covariance)) / before
    told, same = [], []
    for k in np.argsort(ratio).tolist():
        name, (low, high) = posterior.free[k], ends[k].tolist()
        density = prior.distributions[name].density
        below = float(density.cdf(np.array(weighted_quantile(x[:, k], weights, 0.5))))
        if ratio[k] <= ALIKE:
            how = _narrower(1 / ratio[k])
        elif min(below, 1 - below) < MOVED:
            how = f"{'larger' if below > 0.5 else 'smaller'} than before"
        else:
            same.append(_words(name))
            continue
        factor, unit = model.unit_of(name) if name in model.parameters else (1.0, "")
        beside = f", {number(factor * low)} to {number(factor * high)} {unit}" if unit else ""
        told.append(f"{_words(name)} is {number(low)} to {number(high)}{beside}, {how}")
    said = [f"with 90 % probability {_listed(told)}"] if told else []
    said += [f"{_listed(same)} {'are' if len(same) > 1 else 'is'} as uncertain as before"] if same else []
    said += _together(posterior.free, covariance)
    return _sentence(said)


def _together(names: tuple[str, ...], covariance: np.ndarray) -> list[str]:
    """The two parameters that are correlated most, where they are."""
    sd = np.sqrt(np.diag(covariance))
    if len(names) < 2 or not (sd > 0).all():
        return []
    correlation = np.triu(covariance / np.outer(sd, sd), 1)
    row, column = np.unravel_index(np.argmax(np.abs(correlation)), correlation.shape)
    value = float(correlation[row, column])
    if abs(value) < TOGETHER:
        return []
    how = "rise and fall together" if value > 0 else "compensate each other"
    return [f"{_words(names[row])} and {_words(names[column])} {how} (correlation {value:.2f})".replace("-", "−")]


def _narrower(times: float) -> str:
    return f"{times:.2g} times narrower than before" if times < 100 else "over 100 times narrower than before"


def _words(name: str) -> str:
    return name.replace("_", " ")


def _listed(parts: list[str]) -> str:
    between, last = ("; ", "; and ") if any("," in one for one in parts) else (", ", " and ")
    return parts[0] if len(parts) == 1 else f"{between.join(parts[:-1])}{last}{parts[-1]}"


def _sentence(said: list[str]) -> str:
    return f"{capitalised('; '.join(said))}."
