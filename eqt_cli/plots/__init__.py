"""Results as pictures, still and moving; this package is the only importer of matplotlib."""
