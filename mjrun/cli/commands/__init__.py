"""The commands of mjrun: one module each, whose docstring is its line in `mjrun --help`; there is no other list."""
