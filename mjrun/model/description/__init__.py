"""Descriptions of compiled models as typed plain values, one module per kind of object."""
