"""Result files: named, dimensioned arrays in HDF5; it knows no group, controller or physics.

This package is the only importer of h5py.
"""
