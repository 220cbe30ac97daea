"""The command line; no other room uses click or rich."""
