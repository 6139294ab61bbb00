"""Predictions of public flights, written before they were compared with them."""
