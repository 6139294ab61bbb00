"""Files of networks, as text: from ONNX and checkpoints of RLtools."""

from contextlib import suppress
from pathlib import Path

from eqt_cli.base.errors import InputError
from eqt_cli.extensions.network.onnx_files import content_of, of_onnx
from eqt_cli.extensions.network.rltools import of_rltools
from eqt_cli.extensions.network.steps import MISSING, Built


def network_text(path: Path) -> str:
    """Return a network as JSON: all of its inputs and outputs, and the steps between them.

    A step has ``op``, ``out``, ``of``, and numbers. An output has its vector and its shape, or why
    eqt does not compute it. ``start`` are states of recurrent units, and ``examples`` inputs and
    outputs one after the other from there. ``trained`` is what the file says of its training. Of a
    file that is not there, it is `MISSING`.

    Raises
    ------
    InputError
        If the file cannot be read, or has what eqt cannot compute.
    """
    readers = {".onnx": of_onnx, ".h5": of_rltools, ".pt": _of_torch, ".pth": _of_torch}
    if path.suffix not in readers:
        raise InputError(f"{path.name}: expected a network, .onnx or .h5")
    if not path.exists():
        return MISSING
    built = readers[path.suffix](content_of(path), path)
    if len(built.inputs) > 1 and not built.memory:
        with suppress(InputError):  # then the configuration has to say it
            pairs = ", ".join(f"{state}: {later}" for state, later in built.paired().items())
            built.remark(
                f"its memory is {{{pairs}}}, by names and shapes, unless `memory` says otherwise"
            )
    return built.text


def _of_torch(content: bytes, path: Path) -> Built:
    raise InputError(
        f"{path.name}: a file of PyTorch can run code when it is loaded; write it as ONNX with "
        "torch.onnx.export(policy, torch.zeros(1, n), 'policy.onnx'), and give that"
    )
