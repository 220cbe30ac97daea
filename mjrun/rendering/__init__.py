"""Rendering: OpenGL backends, visual options, renderers, and everything drawn onto images."""
