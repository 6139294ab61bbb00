"""A model against a recording: what it predicts of it, and the numbers with which it fits."""
