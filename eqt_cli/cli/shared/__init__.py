"""What several commands share: options, completion, progress, and how results are printed."""
