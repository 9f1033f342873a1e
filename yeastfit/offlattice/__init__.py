"""The off-lattice model of Li et al. 2024: `colony` grows, `li2024_mask` and `ellipse_mask` draw, then one measures."""
