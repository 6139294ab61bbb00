"""The content of results: the table of quantities, and the class `Result` that all readers use."""
