"""The configuration as text: read, located, checked against its schema, and described."""
