"""What `yeastfit infer` does: its request, the run in its folder, what is doubtful, colonies left out."""
