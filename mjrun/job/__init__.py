"""One module per command's work: frozen values that say what to do, and the function that does it."""
