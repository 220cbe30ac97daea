"""Live view of a simulation."""
