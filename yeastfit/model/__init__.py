"""The forward model, one law a file.

Axis names: `node` slots of a colony, `cell` its edges, `x y` the nutrient grid, `i j` its interior, `member`
an ensemble, `sample` the times at which it is observed.
"""
