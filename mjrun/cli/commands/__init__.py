"""The commands of mjrun: a module each, whose docstring is its line in `mjrun --help`. Nothing else lists them."""
