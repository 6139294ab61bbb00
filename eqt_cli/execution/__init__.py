"""Computes a study into its result folder: in parts, which are saved, checked and packed."""
