"""Networks in checkpoints of RLtools, as steps on vectors."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError
from eqt_cli.extensions.network.steps import MOST_NUMBERS, Built, Operand, numbers_of

EXAMPLES = 20
"""Number of steps of the examples in a checkpoint that are kept, and checked."""

_ACTIVATIONS = {"RELU": "Relu", "SIGMOID": "Sigmoid", "TANH": "Tanh", "FAST_TANH": "FastTanh"}


def of_rltools(content: bytes, path: Path) -> Built:
    """Return the actor of a checkpoint of RLtools, with the first of its examples."""
    import h5py

    name = path.name
    try:
        file = h5py.File(io.BytesIO(content), "r")
    except Exception as error:
        raise InputError(f"{name}: is not an HDF5 file: {error}") from error
    with file:
        try:
            return _actor(name, _Checkpoint(name, file))
        except InputError:
            raise
        except Exception as error:  # of h5py many
            raise InputError(f"{name}: is damaged: {error}") from error


def _actor(name: str, actor: "_Checkpoint") -> Built:
    inputs, expected = (actor.numbers(f"example/{key}") for key in ("input", "output"))
    if inputs.ndim != 3 or expected.ndim != 3:
        raise InputError(f"{name}: expected examples of steps, batches and numbers")
    built = Built(name)
    result = actor.layer(built, "actor", built.input("x", [inputs.shape[-1]]))
    built.outputs = {"y": (str(result), [built.size(result)]), **built.outputs}
    sequence = slice(None, EXAMPLES), 0
    built.examples = [inputs[sequence].tolist(), expected[sequence].tolist()]
    return built


class _Checkpoint:
    """The groups of a checkpoint, of which only what the file itself holds is read."""

    def __init__(self, name: str, file: Any) -> None:
        self.name, self.file = name, file

    def _at(self, place: str) -> Any:
        import h5py

        here = self.file
        for part in place.split("/"):
            link = here.get(part, getlink=True) if isinstance(here, h5py.Group) else None
            if type(link) is not h5py.HardLink:
                raise InputError(f"{self.name}: has no {place}, which a checkpoint of RLtools has")
            here = here[part]
        return here

    def numbers(self, place: str) -> Array:
        """Return an array of the file."""
        import h5py

        dataset = self._at(place)
        plain = isinstance(dataset, h5py.Dataset) and not (dataset.external or dataset.is_virtual)
        if not plain or dataset.dtype.kind != "f" or dataset.size > MOST_NUMBERS:
            raise InputError(
                f"{self.name}: {place}: expected at most {MOST_NUMBERS:,} numbers in this file"
            )
        return np.asarray(dataset[()], dtype=float)

    def _of(self, place: str, key: str) -> str:
        value = self._at(place).attrs.get(key, "")
        return value.decode() if isinstance(value, bytes) else str(value)

    def layer(self, built: Built, place: str, of: Operand, deep: int = 0) -> Operand:
        """Add a layer, and return the name of its output."""
        kind = self._of(place, "type")
        if kind == "sequential" and deep < DEEPEST:
            for k in range(len(self._at(f"{place}/layers"))):
                of = self.layer(built, f"{place}/layers/{k}", of, deep + 1)
            return of
        if kind == "mlp":
            hidden = range(int(self._of(place, "num_layers") or 0) - 2)
            for layer_name in [
                "input_layer",
                *(f"hidden_layer_{k}" for k in hidden),
                "output_layer",
            ]:
                of = self._dense(built, f"{place}/{layer_name}", of)
            return of
        if kind == "dense":
            return self._dense(built, place, of)
        if kind == "sample_and_squash":
            return built.entry("Tanh", built.placed([of], np.arange(built.size(of) // 2)))
        if kind != "gru":
            built.refuse(f"the layer {kind or 'without a type'} at {place}")
        W, U, b, d, start = (
            self.numbers(f"{place}/{layer_name}/parameters")
            for layer_name in (
                *("weights_input", "weights_hidden", "biases_input", "biases_hidden"),
                "initial_hidden_state",
            )
        )
        if U.ndim != 2 or len(U) != 3 * U.shape[1] or start.size != U.shape[1]:
            built.refuse(f"recurrent units of other shapes at {place}")
        name = f"h{len(built.memory)}"
        order = np.arange(len(U)).reshape(3, -1)[[1, 0, 2]].ravel()  # r, z, n
        arrays = [np.asarray(x)[order] for x in (W, U, np.ravel(b), np.ravel(d))]
        state = built.gru(of, built.input(name, [U.shape[1]]), arrays)
        built.outputs[f"{name}_next"] = str(state), [U.shape[1]]
        built.memory[name], built.start[name] = f"{name}_next", numbers_of(start, self.name)
        return state

    def _dense(self, built: Built, place: str, of: Operand) -> Operand:
        W, b = (self.numbers(f"{place}/{part}/parameters") for part in ("weights", "biases"))
        of, function = built.affine(of, W, np.ravel(b)), self._of(place, "activation_function")
        if function == "IDENTITY":
            return of
        if function not in _ACTIVATIONS:
            built.refuse(f"the activation {function} at {place}")
        return built.entry(_ACTIVATIONS[function], of)


DEEPEST = 8
"""Most layers within each other."""
