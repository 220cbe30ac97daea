"""Models: load, override, name."""
