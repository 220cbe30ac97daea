"""Parameters of a model from measurements, and how well they are known."""
