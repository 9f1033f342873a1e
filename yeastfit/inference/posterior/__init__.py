"""What all samplers share: the problem, draws, diagnostics, the predictive check."""
