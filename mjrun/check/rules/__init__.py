"""The rules of `mjrun check`, by what they look at."""
