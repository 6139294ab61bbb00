"""What everything builds on: errors, files, units, arrays, expressions and the registry."""
