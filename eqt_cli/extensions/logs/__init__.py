"""Recordings of flights: their formats, columns and units, and the tracking errors in them."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import LOOK_UP, Extension

FORMATS_BY_SUFFIX = {".ulg": "ulog", ".bin": "dataflash"}
FORMATS_BY_SUFFIX |= dict.fromkeys((".bag", ".mcap", ".db3"), "bag")


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("references", "log", "recording_check")
    extension.add_command("log", "commands.log_app", LOOK_UP, after="config")
    extension.add_function(purposes.text_of_a_recording, "tables.text_of_recording")
    extension.add_function(purposes.initial_file, "recording.read_starts")
    extension.add_function(purposes.log_in_a_file, "recording_check.log_of")
    extension.add_function(purposes.reference_smoothing, "smoothing.smoothed_waypoints")
    extension.add_function(purposes.proposed_smoothing, "smoothing.proposed_smoothing")
    extension.add_function(purposes.remarks_on_waypoints, "smoothing.remarks")
    extension.add_function(purposes.show_export, "export_run.export_run")
