"""Malformed command lines: each ends with exit code 2 and one line that names the culprit, and nothing is written.

Nothing is grown or measured: what is wrong is said first. Malformed files are the matter of test_malformed_files.
"""

import csv
import shlex
from pathlib import Path

import pytest

from yeastfit.commands import app as cli

COLUMNS = "file condition replicate hours um_per_pixel area perimeter compactness radius max_radius mask"
RECIPE = "[one]\nseed = 1\nhours = [4.0]\nparameters = {{ mobility = 1.0 }}\n{}"
FILES: dict[str, str | bytes] = {
    "empty.toml": "",
    "broken.toml": "[one\n",
    "utf16.toml": RECIPE.encode("utf-16"),
    "digits.toml": RECIPE.format(f"replicates = {'1' * 5000}\n"),
    "nested.toml": f"a = {'{ a = ' * 3000}1{' }' * 3000}\n",
    "lists.toml": f"a = {'[' * 3000}{']' * 3000}\n",
    "recipes.toml": RECIPE.format(""),
    "field.toml": RECIPE.format("colour = 1\n"),
    "huge.toml": RECIPE.format("numerics = { domain = 1e9 }\n"),
    "nodes.toml": RECIPE.format("numerics = { capacity = 10000000000 }\n"),
    "step.toml": RECIPE.format("numerics = { dt = 1e-300 }\n"),
    "alike.toml": RECIPE.format("") + "[two]\nseed = 1\nhours = [4.0, 4.1]\nparameters = {}\nnumerics = { dt = 0.5 }\n",
    "late.toml": RECIPE.replace("4.0", "1e5").format("numerics = { dt = 1e-5 }\n"),
    "alpha.toml": RECIPE.format("[two]\nseed = 1\nhours = [4.0]\nparameters = { diffusivity = 1e9 }\n"),
    "rate.toml": RECIPE.format("scales = { rate = nan }\n"),
    "length.toml": RECIPE.format("scales = { length = 0 }\n"),
    "stiff.toml": RECIPE.replace("mobility = 1.0", "elasticity = 1e308").format(""),
    "text.toml": RECIPE.format("replicates = 'ten'\n"),
    "prior.toml": "[mobility]\ndistribution = 'uniform'\nlow = nan\nhigh = 1\n",
    "other.toml": "[colour]\ndistribution = 'uniform'\nlow = 0\nhigh = 1\n",
    "broken.json": "{",
    "nested.json": "[" * 3000 + "]" * 3000,
    "number.json": "1",
    "digits.json": "1" * 5000,
    "text.json": '"nothing"',
    "empty.csv": "",
    "utf16.csv": "file,hours\n".encode("utf-16"),
    "words.csv": "one,two\n1,2\n",
    "notes.txt": "no image",
    "a.png": "no image",
}
"""What some of the command lines name. `table/measurements.csv` is sound, and `folder` is an empty folder."""

NOT_A_NUMBER = ("inf", "nan", "-inf", "1_0", "abc", "''", "0x10", "1e999", "1,5", "１０")
WHOLE = "it must be a whole number"
MEMORY = "of memory, this machine has"
SEED = "it must be a whole number from 0 to 18446744073709551615"
NO_FILE = "No such file"
CASES: list[tuple[str, str]] = [
    # --- no command, no option
    ("simulat --out OUT", "simulat"),
    ("--nothing", "--nothing"),
    ("simulate --out OUT --nothing 1", "--nothing"),
    ("simulate", "--out"),
    ("simulate --out OUT more", "more"),
    (
        "simulate --out OUT --births collocated --births-nodes 8589934592 --springs collocated "
        "--springs-nodes 8589934592",
        "nodes is 8589934592, it must be a power of two up to",
    ),
    (
        "simulate --out OUT --births walkers --medium walkers --births-per-bud 1099511627776",
        "--births-per-bud is 1099511627776, it must be from 1 to",
    ),
    (
        "simulate --out OUT --births walkers --medium walkers --medium-walkers 2147483648",
        "walkers is 2147483648, it must be from 1 to",
    ),
    ("simulate --out OUT --fluctuations lognormal --nutrient-noise 1e30", "--nutrient-noise is 1e+30"),
    ("simulate --out OUT --births walkers", "--births walkers needs walkers: choose --medium walkers"),
    ("fit table --out OUT --medium walkers", "--medium walkers excludes --births global it needs --births walkers"),
    ("design --out OUT --springs collocated", "--springs collocated goes with --births collocated only"),
    ("infer table --out OUT --contact cells --shape superellipse", "--contact cells not --shape superellipse"),
    ("synthesize --out OUT --recipe recipes.toml --births walkers", "--births walkers --medium walkers"),
    ("simulate --out OUT --time", "--time"),
    ("measure --out OUT", "paths"),
    ("synthesize --out OUT", "--recipe"),
    ("fit --out OUT", "source"),
    ("infer --out OUT", "SOURCE"),
    ("infer table", "--out"),
    ("infer table --out OUT --simulations 200 --walkers 500", "--walkers is 500, 200 at most"),
    ("fit table --out OUT --free mobility --prior mobility=1e39:0.1", "--prior of mobility is 1e+39, 0.1"),
    ("fit table --out OUT --free mobility --bounds mobility=1e-300:1", "--bounds of mobility are 1e-300, 1"),
    ("infer table --out OUT --jobs 2", "--jobs is given, and table/measurements.csv holds measurements"),
    ("fit table --out OUT --jobs 2", "--jobs is given, and table/measurements.csv holds measurements"),
    ("infer table --out OUT --method abc-smc --distance li --pilot 90", "--pilot is 90, and this distance is not"),
    ("design", "--out"),
    ("compare --out OUT", "runs"),
    ("compare folder folder --out OUT", "folder is given twice"),
    ("compare folder --out OUT", "holds no run.json"),
    ("compare folder nowhere --out OUT", "folder holds no run.json"),
    ("compare folder table", "--out"),
    ("infer table --out OUT --leave-out 1", "--leave-out is 1"),
    (
        "infer table --out OUT --variation-sd 0.2",
        "--variation-zero or --variation-sd is given, a setting of --variation",
    ),
    ("infer table --out OUT --variation-zero 0.1", "--variation-zero or"),
    ("infer table --out OUT --leave-out -1", "--leave-out"),
    ("infer table --out OUT --leave-out 1.5", f"--leave-out is '1.5', {WHOLE}"),
    # --- simulate
    *((f"simulate --out OUT --time {one}", "--time is") for one in NOT_A_NUMBER),
    *((f"simulate --out OUT --mobility {one}", "--mobility is") for one in NOT_A_NUMBER[:4]),
    *(
        (
            f"{command} --{name} {one}",
            f"is {float(one):g}, it must be 0 or of single precision, from 1.2e-38 to 3.4e+38",
        )
        for command in ("simulate --out OUT", "design --out OUT", "gradcheck")
        for name, one in (("diffusivity", "1e300"), ("elasticity", "1e39"), ("metabolic-rate", "1e-300"))
    ),
    *((f"{line} --out ''", "--out is ''") for line in ("simulate", "demo", "infer table", "gradcheck")),
    ("synthesize --recipe recipe.toml --out ''", "--out is ''"),
    ("measure '' --out OUT", "paths is '', need a file or folder"),
    ("infer '' --out OUT", "source is '', need a file or folder"),
    ("infer table --reuse '' --out OUT", "--reuse is '', need a file or folder"),
    ("manifest . --pattern {replicate} --out ''", "--out is ''"),
    ("simulate --out OUT --until-area 0", "--until-area is 0"),
    ("simulate --out OUT --until-cells 5 --every 0.2", "--every is given beside --until-cells"),
    ("simulate --out OUT --until-area 9 --every 99", "--every is given beside --until-area"),
    (
        "simulate --out OUT --model offlattice --movie --beside folder",
        "--beside: photographs have hours offlattice none",
    ),
    ("simulate --out OUT --until-cells -3", "--until-cells is -3"),
    ("simulate --out OUT --pixel-size 0", "--pixel-size is 0"),
    ("simulate --out OUT --pixel-size 1e300", "--pixel-size is 1e+300"),
    ("simulate --out OUT --mobility 1e-400", "--mobility is '1e-400'"),
    *((f"simulate --out OUT --length {one}", "length is from 0.01 to 1000 µm") for one in ("1e300", "1e-300")),
    *((f"simulate --out OUT --rate {one}", "rate is from 0.0001 to 100 per hour") for one in ("1e300", "1e-300")),
    ("simulate --out OUT --time 0", "time is 0"),
    ("simulate --out OUT --time -1", "time is -1"),
    ("simulate --out OUT --time 1e300", "time is 1e+300, 5e+301 steps"),
    ("simulate --out OUT --time 1e9", "time is 1e+09"),
    ("simulate --out OUT --time 1e6 --dt 0.001 --every 0.001", MEMORY),
    ("simulate --out OUT --every 0", "every is 0"),
    ("simulate --out OUT --every -1", "every is -1"),
    ("simulate --out OUT --every 1e-300", "every is 1e-300, it must be at least dt"),
    ("simulate --out OUT --every 20", "every is 20"),
    ("simulate --out OUT --dt 0", "dt is 0"),
    ("simulate --out OUT --dt -0.1", "dt is -0.1"),
    ("simulate --out OUT --dt 1e-300", "dt is 1e-300"),
    ("simulate --out OUT --dt 1e9", "dt is 1"),
    ("simulate --out OUT --spacing 0", "spacing is 0"),
    ("simulate --out OUT --spacing -1", "spacing is -1"),
    ("simulate --out OUT --spacing 1e-9", f"spacing is 1e-09 {MEMORY}"),
    ("simulate --out OUT --domain 1e9", f"domain / spacing is 1e+09 / 0.4 {MEMORY}"),
    ("simulate --out OUT --substeps 0", "substeps is 0, it must be a whole number from 1 to 1000"),
    ("infer demo --out OUT --substeps 1001", "substeps is 1001, it must be a whole number from 1 to 1000"),
    ("simulate --out OUT --domain 1e308 --spacing 0.1", f"domain / spacing {MEMORY}"),
    ("simulate --out OUT --domain 10.03", "domain / spacing is 10.03"),
    ("simulate --out OUT --time 1e-9", "--time is 1e-09, it must be at least dt = 0.02"),
    ("simulate --out OUT --time 0.1 --every 0.2", "--every is 0.2, it must be above 0 and at most the time, 0.1"),
    ("simulate --out OUT --model offlattice --delay 2", "--delay is 2.0, it must be a number from 0 to 1"),
    ("simulate --out OUT --domain 0", "domain is 0"),
    ("simulate --out OUT --capacity 1e10", f"--capacity is '1e10', {WHOLE}"),
    ("simulate --out OUT --capacity 10000000000", f"capacity is 1e+10 {MEMORY}"),
    (f"simulate --out OUT --capacity {'9' * 5000}", "--capacity is"),
    ("simulate --out OUT --capacity 2.5", "--capacity is '2.5'"),
    ("simulate --out OUT --capacity 1", "capacity is 1"),
    ("simulate --out OUT --members 0", "members is 0"),
    ("simulate --out OUT --members -3", "members is -3"),
    ("simulate --out OUT --members 1_0", f"--members is '1_0', {WHOLE}"),
    ("simulate --out OUT --members 1.5", "--members is '1.5'"),
    ("simulate --out OUT --members 1000000000", f"members is 1e+09 {MEMORY}"),
    ("simulate --out OUT --members 1000000", f"members is 1e+06 {MEMORY}"),
    ("simulate --out OUT --rate 0", "rate is 0"),
    ("simulate --out OUT --rate nan", "--rate is 'nan'"),
    ("simulate --out OUT --length -1", "length is -1"),
    ("simulate --out OUT --seed -1", SEED),
    ("simulate --out OUT --seed 18446744073709551616", SEED),
    ("simulate --out OUT --seed 1.0", SEED),
    ("simulate --out OUT --mobility -1", "mobility is -1"),
    ("simulate --out OUT --aspect-ratio 0", "--aspect-ratio is 0"),
    ("simulate --out OUT --aspect-ratio 1.5", "--aspect-ratio is 1.5"),
    ("simulate --out OUT --repulsion-radius 0.6", "--repulsion-radius is 0.6"),
    ("simulate --out OUT --model nothing", "nothing"),
    ("simulate --out OUT --budding nothing", "--budding is 'nothing'"),
    ("simulate --out OUT --hard=1", "--hard"),
    ("simulate --out OUT --model offlattice --cells 0", "cells is 0"),
    ("design --out OUT --model offlattice --match zz", "match is 'zz', it must be li2024 or exactly or each"),
    ("simulate --out OUT --contact cells --repulsivity 3", "--repulsivity has no effect with --contact cells"),
    ("simulate --out OUT --contact constraint --repulsion-radius 0.3", "has no effect with --contact constraint"),
    (
        "simulate --out OUT --births walkers --medium walkers --metabolic-rate 2",
        "--metabolic-rate has no effect with --medium walkers",
    ),
    ("design --out OUT --model offlattice --match none --area 500", "area is 500 and match none, which compares"),
    ("infer table --out OUT --model offlattice --match each --area 500", "area is 500 and match each, which takes the"),
    ("design --out OUT --model offlattice --match each", "match is each, which takes the areas of the data"),
    (
        "simulate --out OUT --model offlattice --nutrient-exponent 0.5",
        "--nutrient-exponent is given, which is for colonies of several areas, and match is li2024: leave it out",
    ),
    (
        "infer table --out OUT --model offlattice --statistics radius --free fork,nutrient_exponent",
        "--free: nutrient_exponent is for colonies of several areas, and match is li2024: leave it out, or give",
    ),
    ("design --out OUT --model offlattice --masks bins --pixel-size 1", "masks are drawn by --masks bins: leave it"),
    ("design --out OUT --times 1,2 --measured-times 7", "--measured-times is 7, need some of --times, 1, 2"),
    ("simulate --out OUT --death starvation --death-rate -2", "--death-rate (h) is -2, it must be finite"),
    ("simulate --out OUT --contact constraint --contact-tolerated -1", "--contact-tolerated is -1.0, an area"),
    ("simulate --out OUT --births collocated --births-nodes 3", "--births-nodes is 3, it must be a power of two"),
    ("infer table --out OUT --method abc-mcmc --tolerance 1 --pilot-quantile 0.3", "--tolerance and --pilot-quantile"),
    ("infer table --out OUT --method abc-smc --population 20 --simulations 20", "--simulations is 20, it must be at"),
    ("infer table --out OUT --method abc-mcmc --move de --pilot-quantile 0.01", "--walkers is 32, de starts each at"),
    ("infer table --out OUT --method abc-mcmc --leave-out 2 --steps 2 --pilot 20 --walkers 1", "--leave-out trains an"),
    ("infer table --out OUT --li --measurement-error 0.02", "--measurement-error is 0.02, with --li it is 0"),
    ("infer table --out OUT --li --colonies 3", "--colonies is 3, with --li it is 1"),
    ("infer table --out OUT --rate 0.0001", "hours of images are 8: a time step, --dt 0.005 at --rate 0.0001 per"),
    ("infer table --out OUT --scheduler tcp://127.0.0.1:1", "no scheduler of Dask answers there"),
    ("infer --print-prior --draws 11", "--draws is given beside --print-prior"),
    ("infer nowhere --print-prior", "SOURCE is given beside --print-prior"),
    ("fit table --out OUT --free mobility --diffusivity 50", "diffusivity"),
    ("fit table --out OUT --free mobility --starts 100", "--starts is 100, it must be at most the points looked at"),
    ("infer table --out OUT --method abc-mcmc --move stretch --walkers 1", "--walkers is 1, stretch with 3 parameters"),
    ("infer table --out OUT --method abc-smc --population 3", "--population is 3, it must be larger than the number"),
    ("infer table --out OUT --method abc-smc --population 20 --simulations 10", "--simulations is 10, it must be at"),
    (
        "infer table --out OUT --simulations 20",
        "--simulations is 20: the first round has 16 simulations, an emulator of 3 parameters",
    ),
    ("infer table --out OUT --no-variation --variation-sd 0.3", "--variation-zero or --variation-sd is given, a"),
    ("infer table --out OUT --model offlattice --statistics radius --cells 1", "--cells is 1, the first cell alone"),
    ("design --out OUT --model offlattice --cells 1", "--cells is 1, the first cell alone"),
    ("infer table --out OUT --method abc-mcmc --colonies 0", "--colonies is 0, it must be at least 1"),
    ("gradcheck --contact-width -1", "--contact-width is -1.0, it must be a number from 0 to 1e+06"),
    ("gradcheck --overwrite", "--overwrite is given without --out"),
    ("fit table --out OUT --bootstrap 1", "--bootstrap is 1, it must be 0 or at least 2 fits"),
    ("gradcheck --time 1 --dt 5", "--time is 1, it must be at least two time steps, --dt 5"),
    ("simulate --out OUT --pixel-size 3", "--pixel-size is given without --statistics, which are measured on such"),
    ("design --out OUT --model offlattice --masks qq", "masks is 'qq', it must be li2024 or bins or ellipses"),
    ("simulate --out OUT --model offlattice --cells 1e4", f"--cells is '1e4', {WHOLE}"),
    ("simulate --out OUT --model offlattice --cells 1000000000000", f"cells is 1e+12 {MEMORY}"),
    ("simulate --out OUT --model offlattice --every 0", "every is 0"),
    ("simulate --out OUT --model offlattice --every 50000", "every is 50000"),
    ("simulate --out OUT --model offlattice --delay -1", "delay is -1"),
    ("simulate --out OUT --model offlattice --delay nan", "--delay is 'nan'"),
    ("simulate --out OUT --model offlattice --fork 2", "fork is 2"),
    ("simulate --out OUT --until-area 1e39", "--until-area is 1e+39"),
    ("simulate --out OUT --model offlattice --members 0", "members is 0"),
    ("simulate --out OUT --model offlattice --time 3", "--time is an option of --model algebraic"),
    ("simulate --out OUT --cells 100", "--cells is an option of --model offlattice"),
    # --- measure
    ("measure nowhere.tif --out OUT", "nowhere.tif"),
    ("measure folder --out OUT", "folder"),
    ("measure a.png nowhere --out OUT", "nowhere"),
    *((f"measure a.png --out OUT --pixel-size {one}", "pixel") for one in ("0", "-1", "nan", "1e-200", "1e9", "1_0")),
    ("measure a.png --out OUT --threshold 1e300", "--threshold is 1e+300, it must be a number above 0, up to 1e+38"),
    ("measure a.png --out OUT --threshold nan", "--threshold is 'nan'"),
    ("measure a.png --out OUT --seed-point 1", "--seed-point is '1'"),
    ("measure a.png --out OUT --seed-point 1,a", "--seed-point is '1,a'"),
    ("measure a.png --out OUT --seed-point 1_0,2", "--seed-point is '1_0,2'"),
    ("measure a.png --out OUT --seed-point nan,2", "--seed-point is 'nan,2'"),
    (
        "measure a.png --out OUT --colonies all --seed-point 5,5",
        "--colonies and --seed-point are 'all' and 5,5, which means one",
    ),
    ("measure a.png --out OUT --roi 5,5,5,5", "--roi is '5,5,5,5', need x0 < x1"),
    ("measure a.png --out OUT --roi 1,2,3", "--roi is '1,2,3'"),
    ("measure a.png --out OUT --roi 0.5,1,2,3", "--roi is '0.5,1,2,3' four whole numbers"),
    ("measure a.png --out OUT --jobs 0", f"--jobs is '0', {WHOLE} from 1 to 10000"),
    ("measure a.png --out OUT --jobs 1_0", "--jobs is '1_0'"),
    # --- synthesize
    ("synthesize --out OUT --recipe nowhere.toml", f"nowhere.toml {NO_FILE}"),
    ("synthesize --out OUT --recipe folder", "folder"),
    *((f"synthesize --out OUT --recipe {one}.toml", f"{one}.toml") for one in ("empty", "broken", "utf16", "digits")),
    *((f"synthesize --out OUT --recipe {one}.toml", f"{one}.toml") for one in ("nested", "lists", "field", "text")),
    ("synthesize --out OUT --recipe huge.toml", f"huge.toml, [one] domain / spacing {MEMORY}"),
    ("synthesize --out OUT --recipe nodes.toml", f"nodes.toml, [one] capacity {MEMORY}"),
    ("synthesize --out OUT --recipe step.toml", "step.toml, [one] dt is 1e-300"),
    (
        "synthesize --out OUT --recipe alike.toml",
        "alike.toml, [two] hours are [4.0, 4.1] a time step from each other, 1.09 hours with numerics.dt = 0.5",
    ),
    ("synthesize --out OUT --recipe late.toml", "late.toml, [one] hours has 100000, which comes too late"),
    ("synthesize --out OUT --recipe alpha.toml", "alpha.toml, [two] diffusivity lower dt"),
    ("synthesize --out OUT --recipe recipes.toml --diffusivity 1e9", "recipes.toml, [one] diffusivity lower dt"),
    ("synthesize --out OUT --recipe recipes.toml --mobility -1", "--mobility (λ5) is -1"),
    ("synthesize --out OUT --recipe rate.toml", "rate.toml, [one] rate is nan"),
    ("synthesize --out OUT --recipe stiff.toml", "stiff.toml, [one] elasticity is 1e+308"),
    ("synthesize --out OUT --recipe length.toml", "length.toml, [one] length is 0"),
    ("synthesize --out OUT --recipe recipes.toml --only two", "recipes.toml 'two' one"),
    ("synthesize --out OUT --recipe recipes.toml --seed -1", SEED),
    ("synthesize --out OUT --recipe recipes.toml --seed 1e3", SEED),
    # --- fit
    ("fit nowhere --out OUT", "nowhere"),
    ("fit folder --out OUT", "folder"),
    ("fit notes.txt --out OUT", "notes.txt"),
    ("fit empty.csv --out OUT", "empty.csv"),
    ("fit utf16.csv --out OUT", "utf16.csv"),
    ("fit words.csv --out OUT", "words.csv"),
    ("fit table --out OUT --condition nothing", "--condition 'nothing'"),
    ("fit table --out OUT --free nothing", "'nothing'"),
    *((f"fit table --out OUT {option} ''", "''") for option in ("--free", "--statistics", "--own", "--method")),
    ("fit table --out OUT --mobility 2", "--mobility is 2, but mobility is free"),
    ("fit table --out OUT --bounds mobility=1:2 --bounds mobility=2:3", "--bounds is given twice for mobility"),
    ("fit table --out OUT --prior mobility=1:0.1 --prior mobility=2:0.1", "--prior is given twice for mobility"),
    ("fit table --out OUT --statistics radius,radius", "--statistics: 'radius' appears twice"),
    ("fit table --out OUT --free mobility,mobility", "--free names 'mobility' twice"),
    ("fit table --out OUT --own nothing", "--own names 'nothing'"),
    ("fit table --out OUT --own mobility,mobility", "--own has mobility twice"),
    ("fit table --out OUT --workers 1000000000", f"--workers is 1e+09 {MEMORY}"),
    ("fit table --out OUT --statistics nothing", "'nothing'"),
    *(
        (f"fit table --out OUT {option} {shlex.quote(one)}", option)
        for option in ("--bounds", "--prior")
        for one in ("mobility", "mobility=1", "mobility=1:2:3", "mobility=a:b", "mobility=nan:1", "mobility=1_0:20")
    ),
    ("fit table --out OUT --bounds nothing=1:2", "nothing"),
    ("fit table --out OUT --bounds mobility=2:1", "mobility"),
    ("fit table --out OUT --bounds mobility=-1:1", "mobility"),
    ("fit table --out OUT --prior nothing=1:0.1", "nothing"),
    ("fit table --out OUT --prior mobility=1:-0.1", "mobility"),
    ("fit table --out OUT --method nothing", "method is 'nothing'"),
    ("fit table --out OUT --starts 0", f"--starts is '0', {WHOLE} of at least 1"),
    ("fit table --out OUT --starts 10000000000", f"starts is 1e+10 {MEMORY}"),
    ("fit table --out OUT --dt 0", "dt is 0"),
    ("fit table --out OUT --dt inf", "--dt is 'inf'"),
    ("fit table --out OUT --spacing 0", "spacing is 0"),
    ("fit table --out OUT --spacing 1e-9", f"spacing is 1e-09 {MEMORY}"),
    ("fit table --out OUT --bounds mobility=1e-300:1", "mobility is 1e-300, it must be 0 or of single precision"),
    ("fit table --out OUT --bounds mobility=1:1e300", "mobility is 1e+300, it must be 0 or of single precision"),
    *(
        (f"fit table --out OUT --prior mobility={one}", "prior of mobility is as width of log λ a number from 1e-06 to")
        for one in ("1:1e300", "1:1e-300", "1e300:1")
    ),
    *(
        (f"{command} --out OUT --measurement-error {one}", f"--measurement-error is '{one}' a number from 0 to 1")
        for command in ("fit table", "infer table", "design")
        for one in ("1e300", "2")
    ),
    ("fit table --out OUT --measurement-error -1", "--measurement-error is '-1'"),
    ("fit table --out OUT --measurement-error nan", "--measurement-error is 'nan'"),
    ("fit table --out OUT --bootstrap -1", "--bootstrap is '-1'"),
    ("fit table --out OUT --bootstrap 1000000000", "--bootstrap is '1000000000' from 0 to 1000000"),
    ("fit table --out OUT --jobs 0", "--jobs is '0'"),
    ("fit table --out OUT --rate -1", "--rate is -1"),
    ("fit table --out OUT --length 1e300", "length is 1e+300, it must be a number from 0.01 to 1000 µm"),
    ("fit table --out OUT --length nan", "--length is 'nan'"),
    ("fit table --out OUT --mobility -1", "mobility is -1"),
    ("fit table --out OUT --truth", "--truth"),
    ("fit table --out OUT --seed 18446744073709551616", SEED),
    ("fit table --out OUT --model offlattice --area 0", "--area is 0.0, it must be a number of at least 40 µm²"),
    ("fit table --out OUT --model offlattice --pixel-size 1e-200", "--pixel-size is 1e-200"),
    # --- infer
    ("infer nowhere --out OUT", "nowhere"),
    ("infer folder --out OUT", "folder"),
    ("infer table --out OUT --method nothing", "nothing"),
    ("infer table --out OUT --model nothing", "nothing"),
    ("infer table --out OUT --free nothing", "nothing"),
    ("infer table --out OUT --statistics nothing", "nothing"),
    *((f"infer table --out OUT {option} ''", "''") for option in ("--free", "--statistics", "--method")),
    ("infer table --out OUT --mobility 2", "--mobility is 2, but mobility is free"),
    ("infer table --out OUT --statistics radius,radius", "--statistics: 'radius' appears twice"),
    ("infer table --out OUT --match size", "match is 'size', it must be time or area"),
    ("infer table --out OUT --area 500", "area is 500 and match time: it is for match area, leave it out"),
    ("infer table --out OUT --match area --area 1", "--area is 1.0, it must be a number of at least 28.1 µm²"),
    ("infer table --out OUT --match area --statistics radius,area", "'area' (--match area)"),
    *(
        (f"{command} --out OUT --statistics radius,centroid_x{model}", "--statistics: 'centroid_x' leave it out")
        for command in ("fit table", "infer table", "design")
        for model in ("", " --model offlattice")
    ),
    *(
        (f"{line} --out OUT --model offlattice --statistics radius,compactness,area", "'area' (--match li2024)")
        for line in ("fit table", "infer table", "design --area 500")
    ),
    ("fit table --out OUT --spacing 5", "--spacing is 5, it must be at most 3 L0"),
    ("infer table --out OUT --spacing 5", "--spacing is 5, it must be at most 3 L0"),
    *(
        (f"{command} table --out OUT --length {length}", f"1_4.tif: um_per_pixel is 0.75, from {ends} µm by --length")
        for command in ("fit", "infer")
        for length, ends in (("1000", "1 to 1000"), ("0.5", "0.0005 to 0.5"))
    ),
    ("infer table --out OUT --model offlattice --pixel-size 100 --masks ellipses", "--pixel-size is 100 to 8.4 µm"),
    (
        "infer table --out OUT --model offlattice --statistics nothing",
        "'nothing' is unknown, expected li2024, texture or some of",
    ),
    ("design --out OUT --model offlattice --statistics radius --pixel-size 100", "--pixel-size is 100 to 8.4 µm"),
    ("design --out OUT --model offlattice --statistics radius --gap -1", "gap (w) is -1"),
    ("design --out OUT --model offlattice --masks bins --gap 6", "masks are drawn by --masks bins: leave it"),
    (
        "design --out OUT --model offlattice --statistics radius --margin 200",
        "margin (d) is 200, it must be in [0, 100]",
    ),
    (
        "infer table --out OUT --model offlattice --statistics compactness --free gap --variation",
        "variation: all colonies share gap: free a parameter of growth, too, or leave it out",
    ),
    ("infer table --out OUT --varying mobility", "--varying, --variation-zero or --variation-sd is given, a setting"),
    (
        "infer table --out OUT --free mobility,diffusivity --variation --varying wind",
        "--varying names 'wind', which is not free: need some of diffusivity, mobility",
    ),
    (
        "infer table --out OUT --model offlattice --statistics compactness --free fork,gap --variation --varying gap",
        "--varying names gap, which all colonies share: need some of fork",
    ),
    ("infer table --out OUT --li --variation", "--variation is given, with --li"),
    ("infer table --out OUT --length 1e300", "length is 1e+300, it must be a number from 0.01 to 1000 µm"),
    ("infer table --out OUT --condition nothing", "--condition 'nothing'"),
    ("infer table --out OUT --draws 5", "--draws is '5'"),
    ("infer table --out OUT --draws 10000000000", f"draws is 1e+10 {MEMORY}"),
    ("infer table --out OUT --prior-draws 99999999999999999999", f"prior-draws is 1e+20 {MEMORY}"),
    ("infer table --out OUT --widen 1e300", "widen is 1e+300, it must be a number from 1 to 1000"),
    ("infer table --out OUT --settle 0", "settle is 0, it must be a number above 0"),
    ("infer table --out OUT --variation --variation-sd 1e300", "--variation-sd is 1e+300, it must be at most 10"),
    ("infer table --out OUT --variation --variation-zero -1", "--variation-zero is -1"),
    ("infer table --out OUT --walkers 0", "walkers is 0"),
    ("infer table --out OUT --walkers 10000000000", f"walkers is 1e+10 {MEMORY}"),
    ("infer table --out OUT --simulations 1000000000000", f"simulations is 1e+12 {MEMORY}"),
    ("infer table --out OUT --first 3", "first is 3"),
    ("infer table --out OUT --settle nan", "--settle is 'nan'"),
    ("infer table --out OUT --widen 0", "widen is 0"),
    ("infer table --out OUT --steps 10", "steps"),
    ("infer table --out OUT --method abc-mcmc --steps 0", "steps is 0"),
    ("infer table --out OUT --method abc-mcmc --steps 10000000 --walkers 10000000", f"steps {MEMORY}"),
    ("infer table --out OUT --method abc-mcmc --tolerance 0", "tolerance is 0"),
    ("infer table --out OUT --method abc-mcmc --tolerance inf", "--tolerance is 'inf'"),
    ("infer table --out OUT --method abc-mcmc --pilot 1", "pilot is 1"),
    ("infer table --out OUT --method abc-mcmc --move nothing", "nothing"),
    ("infer table --out OUT --method abc-mcmc --discard 1000", "discard is 1000"),
    ("infer table --out OUT --method abc-smc --population 10000000000", f"population is 1e+10 {MEMORY}"),
    ("infer table --out OUT --method abc-smc --populations 0", "populations is 0"),
    ("infer table --out OUT --method abc-smc --quantile 1", "quantile is 1"),
    ("infer table --out OUT --li --method emulator", "--li"),
    *((f"infer table --out OUT --prior {one}", one) for one in ("nowhere.toml", "folder", "utf16.toml", "nested.toml")),
    *(
        (f"infer table --out OUT --prior {one}", one)
        for one in ("digits.toml", "lists.toml", "prior.toml", "other.toml")
    ),
    ("infer table --out OUT --reuse nowhere", "--reuse nowhere"),
    ("infer table --out OUT --dt 0", "dt is 0"),
    ("infer table --out OUT --spacing -1", "spacing is -1"),
    ("infer table --out OUT --seed -1", SEED),
    # --- design
    *(
        (f"design --out OUT --times={shlex.quote(one)}", "--times is")
        for one in ("1,a", "1,inf", "1_0", "", "0", "-1,2")
    ),
    ("design --out OUT --times 1e300", MEMORY),
    ("design --out OUT --times 1,1.000001", "--times is [1, 1.000001], it must rise"),
    ("design --out OUT --times 1,2 --same-colonies", "--same-colonies: everything counts as measured"),
    *(
        (f"design --out OUT --times 1,2 --scheduler '{one}'", "--scheduler is it must be like tcp://host:8786")
        for one in ("foo", "", "http://x", "inproc://x", "tcp://x", "tcp://x:999999")
    ),
    (
        "design --out OUT --times 1,2 --added 99999999999999999999",
        "added is 99999999999999999999, it must be a number above 0, up to 1e+06",
    ),
    (
        "design --out OUT --times 1,2 --replicates 9999999999",
        "replicates is 9999999999, it must be a number above 0, up to 1e+06",
    ),
    ("design --out OUT --times 2,60", f"--times has 60, when a colony may have that many nodes: capacity is {MEMORY}"),
    ("design --out OUT --measured-times 1,nan", "--measured-times is '1,nan'"),
    ("design --out OUT --statistics nothing", "nothing"),
    ("design --out OUT --statistics radius,radius", "--statistics: 'radius' appears twice"),
    ("design --out OUT --free nothing", "nothing"),
    ("design --out OUT --measured-times 9", "--measured-times is 9, need some of --times"),
    ("design --out OUT --measured-times ''", "--measured-times is ''"),
    ("design --out OUT --measured-times 1,2,1", "--measured-times has 1 twice"),
    ("design --out OUT --measured-statistics area,area", "--measured-statistics has area twice"),
    ("design --out OUT --measured-statistics nothing", "--measured-statistics: 'nothing'"),
    ("design --out OUT --measured-statistics ''", "--measured-statistics: ''"),
    ("design --out OUT --runs 17", "runs is 17"),
    ("design --out OUT --runs 0", "runs is 0"),
    ("design --out OUT --runs 16", "--runs is 16 15 means --runs 32 or more"),
    ("design --out OUT --model offlattice --measured-times 3", "--measured-times is 3 have no times"),
    ("design --out OUT --model offlattice --transition 0", "--transition is 0 above 0, or leave it out of --free"),
    ("design --out OUT --mobility 0", "--mobility is 0 give a value above 0"),
    ("design --out OUT --same-colonies --added 10", "--added is given beside --same-colonies"),
    ("design --out OUT --measured-times none --replicates 10", "--replicates is given beside --measured-times none"),
    (
        "design --out OUT --measured-times none --measured-statistics radius",
        "--measured-statistics is given beside --measured-times none",
    ),
    ("design --out OUT --times 1,2 --same-colonies --measured-times 1,2", "--same-colonies: everything counts"),
    ("design --out OUT --runs 16000000000", f"runs is 1.6e+10 {MEMORY}"),
    ("design --out OUT --dt 0", "dt is 0"),
    ("design --out OUT --steps 0", "--steps is '0'"),
    ("design --out OUT --added 0", "--added is '0'"),
    ("design --out OUT --replicates 1.5", "--replicates is '1.5'"),
    ("design --out OUT --measurement-error -1", "--measurement-error is '-1'"),
    *(
        (f"design --out OUT --sensitivity {one}", one)
        for one in ("nowhere.json", "folder", "broken.json", "number.json")
    ),
    *(
        (f"design --out OUT --sensitivity {one}", one)
        for one in ("nested.json", "digits.json", "text.json", "notes.txt")
    ),
    ("design --out OUT --sensitivity number.json --runs 256", "--runs is given beside --sensitivity"),
    ("design --out OUT --sensitivity number.json --seed 0", "--seed is given beside --sensitivity"),
    # --- gradcheck
    ("gradcheck --out OUT --time 0", "0"),
    ("gradcheck --out OUT --time nan", "--time is 'nan'"),
    ("gradcheck --out OUT --time 1e300", "time is 1e+300"),
    ("gradcheck --out OUT --dt 0", "dt is 0"),
    ("gradcheck --out OUT --domain 1e9", f"domain / spacing {MEMORY}"),
    ("gradcheck --out OUT --capacity 10000000000", f"capacity is 1e+10 {MEMORY}"),
    ("gradcheck --out OUT --contact-width 1e300", "--contact-width is 1e+300, it must be a number from 0 to 1e+06"),
    ("gradcheck --out OUT --tolerance inf", "--tolerance is 'inf'"),
    ("gradcheck --out OUT --tolerance 0", "tolerance is 0"),
    ("gradcheck --out OUT --mobility 1_0", "--mobility is '1_0'"),
    # --- manifest
    ("manifest", "folder"),
    ("manifest folder", "--pattern"),
    ("manifest nowhere --pattern {replicate}", "nowhere"),
    ("manifest folder --pattern {replicate}", "folder"),
    ("manifest . --pattern {replicate} --hours 1_0", "--hours is '1_0'"),
    ("manifest . --pattern {replicate} --hours 4 --pixel-size 0", "--pixel-size '0'"),
    # --- demo
    ("demo --out OUT --jobs 0", "--jobs is '0'"),
    ("demo --out OUT --nothing", "--nothing"),
]


def contents(folder: Path) -> dict[str, bytes | None]:
    """Of every file below a folder; None for folders."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with `FILES`, the current one."""
    monkeypatch.chdir(tmp_path)
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    for name in ("folder", "table"):
        (tmp_path / name).mkdir()
    with (tmp_path / "table" / "measurements.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS.split())
        for replicate in (1, 2, 3):
            for hours, radius in ((4, 10.0), (8, 15.0)):
                name, more = f"{replicate}_{hours}", 1.0 + 0.01 * replicate
                sizes = [3.1 * radius**2 * more, 6.4 * radius, 0.9 * more, radius * more, 1.4 * radius]
                table.writerow([f"{name}.tif", "", replicate, hours, 0.75, *sizes, f"{name}.png"])
    return tmp_path


@pytest.mark.parametrize(("line", "words"), CASES, ids=[line[:70] for line, _ in CASES])
def test_a_malformed_command_line_is_refused(
    line: str, words: str, files: Path, unchecked: None, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(files)
    code = cli.run([part.replace("OUT", "results") for part in shlex.split(line)])
    output = capsys.readouterr()
    assert (code, output.out) == (2, ""), output.err
    (said,) = output.err.splitlines()
    assert said.startswith("error: ")
    assert len(said) < 500
    place = 0
    for part in words.split(" "):
        assert part in said[place:], f"{part!r} after {said[:place]!r} in {said!r}"
        place = said.index(part, place) + len(part)
    assert contents(files) == before


def test_there_are_many_of_all_commands() -> None:
    assert len({line for line, _ in CASES}) == len(CASES) >= 200
    for command in cli.COMMANDS:
        assert sum(line.startswith(command) for line, _ in CASES) >= 2
