"""Recipes of synthetic data sets and their truth: what is wrong is one line that names file, table and value."""

import json
from pathlib import Path

import pytest
from helpers import wrong_types

from yeastfit.errors import InputError
from yeastfit.simulation.recipe import Recipe, read_recipes, read_truth

GOOD = "[a]\nseed = 1\nhours = [4, 8.5]\nparameters = { mobility = 2 }\n"


def test_a_recipe_is_read(tmp_path: Path) -> None:
    (tmp_path / "r.toml").write_text(
        GOOD + "pixel_size = 1\noptics = { speck_radius = [0.5, 1] }\nscales = { rate = 1 }\n"
    )
    (recipe,) = read_recipes(tmp_path / "r.toml").values()
    assert (recipe.hours, recipe.parameters, recipe.pixel_size) == ((4, 8.5), {"mobility": 2}, 1)
    assert (recipe.optics.speck_radius, recipe.scales.rate) == ((0.5, 1), 1)


BAD = {
    "": "no data set there",
    "a = 1": "[a]: is 1, need a table with parameters, seed and hours",
    "[a]\nseed = 1\n": "[a]: parameters is missing",
    "[..]": "not TOML",
    GOOD.replace("[a]", "['..']"): "called '..'",
    GOOD.replace("[a]", "['']"): "called ''",
    GOOD.replace("[a]", "['a/b']"): "called 'a/b'",
    GOOD + GOOD.replace("[a]", "[A]"): "data sets are called 'a' and 'A', which are one folder on many systems",
    GOOD.replace("[a]", '["a\\nb"]'): r"called 'a\nb'",
    GOOD.replace("[a]", f"['{'x' * 300}']"): "called 'xxx",
    GOOD + "colour = 1": "'colour' is unknown, expected some of extent, hours",
    GOOD.replace("seed = 1", "seed = '1'"): "seed is '1'",
    GOOD.replace("seed = 1", "seed = -1"): "seed is -1",
    GOOD.replace("seed = 1", "seed = 1.5"): "seed is 1.5",
    GOOD.replace("seed = 1", f"seed = {'1' * 5000}"): "not TOML (Exceeds the limit (4300 digits)",
    GOOD.replace("[4, 8.5]", "[]"): "hours: there are none",
    GOOD.replace("[4, 8.5]", "4"): "hours is 4, it must be a list",
    GOOD.replace("[4, 8.5]", "'4'"): "hours is '4', it must be a list",
    GOOD.replace("[4, 8.5]", "['4']"): "hours is '4', it must be a number from 0.001 to 100000 hours",
    GOOD.replace("[4, 8.5]", "[true]"): "hours is true",
    GOOD.replace("[4, 8.5]", "[0]"): "hours is 0",
    GOOD.replace("[4, 8.5]", "[inf]"): "hours is inf",
    GOOD.replace("[4, 8.5]", "[8, 4]"): "[8, 4], they must rise",
    GOOD.replace("[4, 8.5]", "[4.01, 4.04]"): "[4.01, 4.04], they must differ in their first decimal",
    GOOD.replace("{ mobility = 2 }", "3"): "parameters is 3",
    GOOD + "numerics = { dt = 3 }": "[4, 8.5], they must lie at least a time step from 0 and from each other, 6.52",
    GOOD.replace("4, 8.5", "0.1, 8") + "numerics = { dt = 0.2 }": "from each other, 0.435 hours with numerics.dt = 0.2",
    GOOD.replace("mobility = 2", "mobility = '2'"): "parameters: mobility is '2', it must be a finite number",
    GOOD.replace("mobility = 2", "mobility = nan"): "parameters: mobility is nan",
    GOOD.replace("mobility = 2", "mobility = -2"): "mobility",
    GOOD.replace("mobility = 2", "colour = 2"): "'colour'",
    GOOD.replace("mobility = 2", "budding_bias = 2"): "[a]: budding_bias is a parameter of budding 'biased' or budding",
    GOOD + "replicates = 0": "replicates is 0, it must be a number from 1 to 10000",
    GOOD + "replicates = 2.5": "replicates is 2.5, it must be a whole number from 1 to 10000",
    GOOD + "replicates = '2'": "replicates is '2'",
    GOOD + "replicates = 1000000000000": "replicates is 1000000000000, it must be a",
    GOOD + "pixel_size = 1e-200": "pixel_size is 1e-200, it must be a number from 0.001 to 1000 µm",
    GOOD + "pixel_size = '1'": "pixel_size is '1'",
    GOOD + "extent = 1e9": "extent is 1000000000.0, it must be a number from 12 to 7500 µm, as pixel_size is 0.75",
    GOOD + "extent = 1": "extent is 1,",
    GOOD + "kind = 'gif'": "kind is 'gif', it must be one of tiff, imagej, ome",
    GOOD + "kind = [1]": "kind is [1]",
    GOOD + "numerics = 3": "numerics is 3, it must be a table",
    GOOD + "numerics = { steps = 3 }": "numerics: 'steps' is unknown, expected some of domain, spacing",
    GOOD + "numerics = { dt = '3' }": "dt is '3'",
    GOOD + "numerics = { capacity = 1.5 }": "capacity is 1.5",
    GOOD + "scales = { rate = '1' }": "scale rate is '1'",
    GOOD + "optics = { blur = 'much' }": "optics blur: got 'much'",
    GOOD + "optics = { blur = 1e9 }": "optics blur: got 1000000000.0, need a number, finite, at least 0 and at most",
    GOOD + "optics = { specks = 1e12 }": "and at most 1000",
    GOOD + "optics = { base = 1e300 }": "and at most 100",
    GOOD + "optics = { speck_radius = 1 }": "optics speck_radius: got 1",
    GOOD + "model = 'uniform'": "model is 'uniform', it must be a table of rules",
    GOOD + "model = { budding = 'uniform' }": "budding is 'uniform'",
    GOOD + "model = { budding = { rule = 'none' } }": "rule 'none' is unknown",
    GOOD + "model = { eating = { rule = 'none' } }": "'eating' is unknown",
    GOOD + GOOD: "not TOML",
    "x = " + "[" * 3000 + "]" * 3000: "too many",
    "[a]\nseed = \x00": "line 2: holds a NUL",
    "ÿþ": "not TOML",
}


@pytest.mark.parametrize("number", range(len(BAD)))
def test_a_bad_recipe_is_refused_in_one_line(tmp_path: Path, number: int) -> None:
    text, words = list(BAD.items())[number]
    (tmp_path / "r.toml").write_text(text, encoding="utf-8")
    with wrong_types(), pytest.raises(InputError) as caught:
        read_recipes(tmp_path / "r.toml")
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "r.toml"))
    assert words in message
    assert "\n" not in message
    assert len(message) < len(str(tmp_path)) + 300


@pytest.mark.parametrize(
    ("data", "words"),
    [(b"", "cannot be read"), (b"\xff\xfe{}", "need UTF-8"), (b"[a]\n\xff", "line 2: not a text file in UTF-8")],
)
def test_other_files_are_no_recipes(tmp_path: Path, data: bytes, words: str) -> None:
    path = tmp_path / "r.toml"
    if data:
        path.write_bytes(data)
    else:
        path.mkdir()
    with pytest.raises(InputError, match=words):
        read_recipes(path)


def test_recipes_in_python_are_checked_alike() -> None:
    with pytest.raises(InputError, match="hours is nan"):
        Recipe({}, 1, (float("nan"),))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "cannot be read"),
        ("{", "cannot be read"),
        ("[1]", r"holds \[1\], need parameters by name"),
        ("{}", "diffusivity is missing, need a finite number"),
        ('{"diffusivity": "2"}', "diffusivity is '2'"),
        ('{"diffusivity": "NaN"}', "diffusivity is nan"),
        ('{"diffusivity": {"a": 1}}', "diffusivity is {a = 1}"),
        ("[" * 100_000, "cannot be read"),
        ("\x00", "cannot be read"),
    ],
)
def test_a_broken_truth_is_refused_in_one_line(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "truth" / "parameters.json"
    path.parent.mkdir()
    path.write_text(content)
    with pytest.raises(InputError, match=words) as caught:
        read_truth(tmp_path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_truth_that_the_model_cannot_have_is_refused(tmp_path: Path) -> None:
    (tmp_path / "truth").mkdir()
    names = ("mobility", "metabolic_rate", "aspect_ratio", "diffusivity", "elasticity", "repulsivity")
    values = dict.fromkeys((*names, "repulsion_radius"), 0.5)
    path = tmp_path / "truth" / "parameters.json"
    path.write_text(json.dumps(values))
    assert read_truth(tmp_path) == values
    path.write_text(json.dumps({**values, "aspect_ratio": 7}))
    with pytest.raises(InputError, match=r"parameters\.json: aspect_ratio .* is 7, it must be"):
        read_truth(tmp_path)
