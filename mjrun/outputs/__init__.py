"""A module for each output of a simulation, and the pass that makes them together."""
