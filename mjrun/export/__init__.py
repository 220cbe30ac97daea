"""Sinks: where frames and rows go, published whole or not at all."""
