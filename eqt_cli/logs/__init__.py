"""Recordings and other tables of poses in files: what their columns mean, and what they hold."""
