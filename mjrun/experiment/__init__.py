"""Experiments of many simulations: points, metrics, the table of results, and requirements on it."""
