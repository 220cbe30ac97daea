"""Models: sources, compilation, overrides, names and descriptions."""
