"""What every layer stands on: errors, the component registry, array functions, expressions."""
