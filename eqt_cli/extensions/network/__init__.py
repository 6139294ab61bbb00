"""Laws that are neural networks, from the files that trainers write."""

COMPONENTS = {"controllers": {"network": "network"}}
