"""The mechanics of the paper on any matrix Lie group, as plain functions of arrays."""
