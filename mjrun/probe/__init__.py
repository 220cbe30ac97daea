"""Probes: what can be measured, selected by name."""
