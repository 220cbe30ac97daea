"""Descriptions of compiled models, a module per kind of object, as typed plain values."""
