"""What runs are compared by: colonies left out and predicted, models on the same data, conditions under one model."""
