"""Pages of results, one file each."""
