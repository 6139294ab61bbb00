"""Options, completion, progress and printing, shared by several commands."""
