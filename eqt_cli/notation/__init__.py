"""Poses and tensors as they are written in a configuration."""
