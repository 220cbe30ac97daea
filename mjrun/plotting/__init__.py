"""Figures of tables: which curves, how many samples become few points, and how matplotlib draws them."""
