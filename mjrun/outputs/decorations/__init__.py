"""Decorations of images: a module of this package draws what the view option of its name requests."""
