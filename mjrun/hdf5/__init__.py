"""Access to HDF5 files that are untrusted: strings in their heap, and limits on the content of datasets."""
