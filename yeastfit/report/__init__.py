"""Pages, and the files that commands leave."""
