"""The rigs of a camera: how a view moves. One module each, or for several that are alike."""
