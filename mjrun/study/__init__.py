"""Studies: many simulations of one model, each with its own values, and what comes of them."""
