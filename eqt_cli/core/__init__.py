"""Foundations of all layers: errors, the component registry, array functions, expressions."""
