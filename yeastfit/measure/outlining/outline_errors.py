"""How far statistics are apart where two people outline the same colonies: their means, and single colonies.

Nine photographs of filamentous colonies (Li et al. 2024, 2 to 2.5 mm across, 1.55 µm a pixel), outlined by `measure`,
and the authors' own masks of them: √(b² + s²/n) over the mean, b the mean difference, s its standard deviation, n = 9
(docs/outlines.md, which `benchmarks.outline_errors` writes). Neither outline is the truth. Means of photographed
colonies are known no better than that, however many there are. Beyond what is common to all, each colony has an error
of its own, s/√2 if two outlines are alike: in means it is part of the scatter of replicates; where parameters scatter
between colonies, and single ones are the data, it must not be taken for such a scatter.
"""

OUTLINE_ERRORS = {
    "compactness": 0.083,
    "outer_compactness": 0.14,
    "largest_compactness": 0.06,
    "radius": 0.019,
    "largest_radius": 0.019,
    "max_radius": 0.025,
    "area": 0.038,
    "largest_area": 0.038,
    "perimeter": 0.058,
    "outer_perimeter": 0.085,
    "object_count": 6.4,
    "hole_count": 0.5,
    "solidity": 0.021,
    "outer_hull_share": 0.044,
    "csr_radius": 0.018,
    "perimeter_radius": 0.02,
    "filament_area": 0.13,
    "filament_area_index": 0.044,
    "filament_radius_index": 0.042,
    "branch_count": 0.098,
    "branch_length": 0.069,
    "filament_width": 0.13,
    "radial_index": 0.03,
    "angular_index": 0.064,
    "wave_number": 0.2,
    "li2024_csr_radius": 0.018,
    "li2024_filament_area_index": 0.044,
    "li2024_filament_radius_index": 0.041,
    "li2024_branch_index": 0.12,
    "smoothed_branch_index": 0.13,
    "smoothed_compactness": 0.22,
    "smoothed_branch_count": 0.11,
    "smoothed_branch_length": 0.1,
    "smoothed_filament_width": 0.043,
}
"""Relative errors by statistic. The fractal dimension, the radius of the largest circle inside and the share of the
largest object have less than 0.01."""

COLONY_ERRORS = {
    "compactness": 0.11,
    "radius": 0.028,
    "area": 0.059,
    "perimeter": 0.066,
    "outer_perimeter": 0.058,
    "outer_compactness": 0.1,
    "max_radius": 0.03,
    "inscribed_radius": 0.005,
    "hole_count": 0.34,
    "solidity": 0.019,
    "outer_hull_share": 0.066,
    "largest_share": 0.00055,
    "largest_area": 0.059,
    "largest_compactness": 0.09,
    "largest_radius": 0.028,
    "fractal_dimension": 0.0052,
    "csr_radius": 0.026,
    "filament_area_index": 0.067,
    "filament_radius_index": 0.022,
    "perimeter_radius": 0.03,
    "filament_area": 0.11,
    "branch_count": 0.14,
    "branch_length": 0.052,
    "filament_width": 0.18,
    "radial_index": 0.019,
    "angular_index": 0.11,
    "wave_number": 0.42,
    "li2024_filament_area_index": 0.067,
    "li2024_filament_radius_index": 0.022,
    "li2024_branch_index": 0.21,
    "smoothed_branch_index": 0.15,
    "smoothed_compactness": 0.15,
    "smoothed_branch_count": 0.2,
    "smoothed_branch_length": 0.095,
    "smoothed_filament_width": 0.092,
}
"""Relative errors that every outline has for itself, by statistic: s/√2."""
