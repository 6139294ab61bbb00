"""Results: stored quantities, metrics, and the `Result` that all readers share."""
