"""eqt: experiments with equivariant tracking control on matrix Lie groups."""

__version__ = "0.1.0"
