"""Makes the harness importable: test folders are no packages."""

import importlib.util
import sys
from pathlib import Path

_spec = importlib.util.spec_from_file_location(
    "faults_harness", Path(__file__).with_name("harness.py")
)
_harness = importlib.util.module_from_spec(_spec)
sys.modules["faults_harness"] = _harness
_spec.loader.exec_module(_harness)
