"""Makes what these tests share importable: test folders are no packages."""

import importlib.util
import sys
from pathlib import Path

_spec = importlib.util.spec_from_file_location(
    "exported_laws", Path(__file__).with_name("exported_laws.py")
)
_laws = importlib.util.module_from_spec(_spec)
sys.modules["exported_laws"] = _laws
_spec.loader.exec_module(_laws)
