"""One run as a moving picture."""
