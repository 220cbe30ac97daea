"""Differences between operating systems."""
