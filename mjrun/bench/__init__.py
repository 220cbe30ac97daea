"""The measurement of simulations: what steps, frames and outputs cost."""
