"""What all samplers share: priors, draws, diagnostics, stored simulations, the predictive check."""
