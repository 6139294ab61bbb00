"""What a result holds and what it means: its quantities, and one `Result` that readers share."""
