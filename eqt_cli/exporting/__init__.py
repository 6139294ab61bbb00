"""Laws as C for a vehicle: files that need nothing of eqt, with what was found out about them."""

from eqt_cli.exporting.laws import Exported, ExportedLaw, exported

__all__ = ["Exported", "ExportedLaw", "exported"]
