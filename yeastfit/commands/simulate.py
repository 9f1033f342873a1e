"""`yeastfit simulate`: grow colonies, write their statistics as they grow and draw them."""

from typing import Annotated

import typer

from yeastfit import plot
from yeastfit.commands.generated_options import generated
from yeastfit.commands.model_options import ChosenModel, ModelOptions
from yeastfit.commands.options import Out, Seed
from yeastfit.commands.terminal import out, shown_progress, warn
from yeastfit.simulation.synthetic_data import write_mask
from yeastfit.storage import write_manifest, write_table


@generated(chosen=ModelOptions("simulate"))
def simulate(
    folder: Out,
    members: Annotated[int, typer.Option(help="Number of colonies to grow.")] = 4,
    seed: Seed = 0,
    *,
    chosen: ChosenModel,
) -> None:
    """Simulate growing colonies.

    Writes curves.csv, with a row for each colony and time (or number of cells, for a model without time), pictures of
    the curves and of every colony, and simulation.npz. Colonies of the off-lattice model are also written as masks,
    which yeastfit measure reads. Lengths are in µm in columns that end in _um and for the off-lattice model, otherwise
    in cell lengths L0.
    """
    with shown_progress("growing colonies") as progress:
        result = chosen.forward.grow(chosen.values, members, seed)
        write_table(folder / "curves.csv", result.rows())
        result.save(folder / "simulation.npz")
        plot.save(plot.curves(result), folder / "curves.png")
        for member in range(members):
            progress(f"drawing colony {member + 1} of {members}", member / members)
            plot.save(plot.colony(result, member), folder / f"colony_{member}.png")
        if (drawn := result.masks()) is not None:
            (folder / "masks").mkdir(exist_ok=True)
            for member, mask in enumerate(drawn[0]):
                write_mask(folder / "masks" / f"colony_{member}.png", mask, drawn[1])
    warn(result.warnings())
    parameters = {**chosen.forward.parameters.defaults, **chosen.values}
    configuration = {**chosen.configuration("simulate"), "parameters": parameters, "members": members}
    more = {"configuration": configuration, "seconds": result.seconds}
    write_manifest(folder, command="simulate", seed=seed, inputs=[], **more)
    out.print(f"{result.sentence()}. Results in {folder}")
