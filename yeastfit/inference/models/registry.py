"""Forward models by name, for the command line: what `--model NAME` can simulate, fit, infer and design for.

A new one is a subclass of `ForwardModel` and an entry here or, from outside the package,
`yeastfit.FORWARD_MODELS["name"] = Class`.
"""

from yeastfit.errors import InputError
from yeastfit.inference.models.algebraic import Algebraic
from yeastfit.inference.models.forward_model import ForwardModel
from yeastfit.inference.models.offlattice import Offlattice

FORWARD_MODELS: dict[str, type[ForwardModel]] = {"algebraic": Algebraic, "offlattice": Offlattice}

DEFAULT = "algebraic"


def model_named(name: str) -> type[ForwardModel]:
    """The class of a registered model.

    Raises:
        InputError: There is none of this name.
    """
    if name not in FORWARD_MODELS:
        raise InputError(f"--model is {name!r}, it must be one of {', '.join(FORWARD_MODELS)}")
    return FORWARD_MODELS[name]
