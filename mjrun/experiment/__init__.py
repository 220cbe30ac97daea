"""What studies and evaluations have in common: points, the table of results, and what is required of it."""
