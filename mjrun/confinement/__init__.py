"""Confinement of a process that works on untrusted files."""
