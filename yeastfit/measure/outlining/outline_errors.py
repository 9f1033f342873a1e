"""How far means of statistics are apart where two people outline the same colonies.

Nine photographs of filamentous colonies (Li et al. 2024, 2 to 2.5 mm across, 1.55 µm a pixel), outlined by `measure`,
and the authors' own masks of them: √(b² + s²/n) over the mean, b the mean difference, s its standard deviation, n = 9
(docs/outlines.md, which `benchmarks.outline_errors` writes). Neither outline is the truth. Means of photographed
colonies are known no better than that, however many there are; the scatter of single ones is in the replicates.
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
}
"""Relative errors by statistic. The fractal dimension, the radius of the largest circle inside and the share of the
largest object have less than 0.01."""
