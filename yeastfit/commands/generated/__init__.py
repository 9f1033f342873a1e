"""Options that follow from what is registered: models, their rules and parameters, and samplers."""
