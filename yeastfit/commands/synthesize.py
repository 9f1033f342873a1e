"""`yeastfit synthesize`: make data sets of synthetic micrographs with known parameters."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from yeastfit.commands.console.terminal import out, shown_progress
from yeastfit.commands.generated.options import generated
from yeastfit.commands.generated.rules import RecipeOptions
from yeastfit.commands.options import Out, Overwrite
from yeastfit.errors import InputError
from yeastfit.numbers import SEEDS
from yeastfit.results.check import check_folder
from yeastfit.simulation.recipe import Recipe, read_recipes
from yeastfit.simulation.synthetic_data import synthesize as make_dataset


@generated(changed=RecipeOptions())
def synthesize(
    folder: Out,
    recipe: Annotated[
        Path, typer.Option(help="TOML file that describes the data sets, one table for each.", show_default=False)
    ],
    only: Annotated[
        list[str] | None,
        typer.Option(help="Name of a data set to make; repeat it for several. By default all are made."),
    ] = None,
    overwrite: Overwrite = False,
    seed: Annotated[
        int | None, typer.Option(min=0, max=SEEDS.high, help="Seed to use instead of the one in the file.")
    ] = None,
    *,
    changed: Callable[[Recipe], Recipe],
) -> None:
    """Make synthetic micrographs of simulated colonies.

    Each data set is a folder below OUT with photographs, a manifest that `yeastfit fit` reads, and the folder truth,
    which holds the parameters, outlines and curves that the photographs were made from. Rules and parameters that are
    given here take the place of the file's.
    """
    recipes = read_recipes(recipe)
    unknown = sorted(set(only or ()) - set(recipes))
    if unknown:
        raise InputError(f"{recipe}: no data set {unknown[0]!r}, need some of {', '.join(recipes)}")
    recipes = {name: changed(recipes[name]) for name in only or recipes}
    for name, each in recipes.items():
        each.truth()  # with what is given here
        try:
            each.check()
        except InputError as error:
            raise InputError(f"{recipe}, [{name}]: {error}") from None
        check_folder(folder / name, "synthesize", reads=[recipe], overwrite=overwrite)
    for name, each in recipes.items():
        each = each if seed is None else replace(each, seed=seed)
        with shown_progress(f"growing {name}") as progress:
            make_dataset(each, folder / name, progress, inputs=[recipe], overwrite=overwrite)
        out.print(f"{name}: {each.replicates} colonies at {len(each.hours)} times in {folder / name}")
