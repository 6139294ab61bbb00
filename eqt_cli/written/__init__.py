"""Poses, tensors and trajectories as they are written: in a configuration, or in a file."""
