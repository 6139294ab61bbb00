"""The data that figures show, and what they leave out; nothing here knows how they are drawn."""
