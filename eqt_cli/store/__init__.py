"""Result files: named, dimensioned arrays in HDF5, without knowledge of their meaning.

This package is the only importer of h5py.
"""
