"""Changes texts in result files, where strings have a fixed length."""

import h5py
import numpy as np


def fixed(value):
    """A value as an attribute of a result file: text of fixed length, others as they are."""
    return np.bytes_(value.encode()) if isinstance(value, str) else value


def retext(file, name, texts):
    """Replace the texts of a dimension by some of any length."""
    datasets = [entry for entry in file.values() if isinstance(entry, h5py.Dataset)]
    dims = [dim for dataset in datasets for dim in dataset.dims if file[name] in dim.values()]
    for dim in dims:
        dim.detach_scale(file[name])
    del file[name]
    file[name] = np.array([text.encode() for text in texts])
    file[name].make_scale(name)
    for dim in dims:
        dim.attach_scale(file[name])


def of_variable_length(path):
    """The places of all strings of variable length in a file: of datasets, and of attributes."""
    kinds = {}

    def note(name, entry):
        if isinstance(entry, h5py.Dataset):
            kinds[name] = entry.id.get_type()
        for attribute in entry.attrs:
            kinds[f"{name}.{attribute}"] = entry.attrs.get_id(attribute).get_type()

    with h5py.File(path) as file:
        note("", file)
        file.visititems(note)
    texts = {k: kind for k, kind in kinds.items() if isinstance(kind, h5py.h5t.TypeStringID)}
    assert ".config" in texts and "controller" in texts
    return [k for k, kind in texts.items() if kind.is_variable_str()]
