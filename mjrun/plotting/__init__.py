"""Figures of tables: the choice of curves, the reduction of samples to points, and drawing with matplotlib."""
