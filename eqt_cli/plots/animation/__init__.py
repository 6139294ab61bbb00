"""Animation of one run."""
