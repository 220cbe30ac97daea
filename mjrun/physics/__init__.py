"""Simulation: initial state, stepping, observing, recording."""
