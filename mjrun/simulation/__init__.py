"""A simulation as it was asked for: a model with its inputs, and what verifies it."""
