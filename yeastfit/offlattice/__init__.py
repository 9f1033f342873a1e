"""The off-lattice model of Li et al. 2024: growth, masks, statistics."""
