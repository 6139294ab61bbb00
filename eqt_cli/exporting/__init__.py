"""Laws as C for a vehicle: files that do not need eqt, with what is known of their errors."""

from eqt_cli.exporting.laws import Exported, ExportedLaw, exported

__all__ = ["Exported", "ExportedLaw", "exported"]
