"""A simulation, looked at live."""
