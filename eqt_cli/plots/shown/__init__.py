"""What of results figures show, and what they leave out; it must not know how they are drawn."""
