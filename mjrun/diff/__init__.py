"""Comparison of results: tables, recordings, videos, images and models."""
