"""Camera rigs, which determine how a view moves: each is found by its place in a module of this package."""
