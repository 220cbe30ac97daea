"""File formats: one module each, with its suffixes, its reader and its writer."""
