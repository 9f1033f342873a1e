"""HTML pages and files of results."""
