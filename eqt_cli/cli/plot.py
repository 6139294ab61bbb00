"""`eqt plot`: draw a result."""
