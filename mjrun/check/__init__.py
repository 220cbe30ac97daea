"""The lint of models: what is wrong with them, or will be."""
