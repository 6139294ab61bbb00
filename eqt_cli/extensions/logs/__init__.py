"""Recordings of flights: their formats, columns and units, and the tracking errors in them."""

from eqt_cli.base.extensions import LOOK_UP, Extension

FORMATS_BY_SUFFIX = {".ulg": "ulog", ".bin": "dataflash"}
FORMATS_BY_SUFFIX |= dict.fromkeys((".bag", ".mcap", ".db3"), "bag")


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("references", "log", "recording_check")
    extension.add_command("log", "commands.log_app", LOOK_UP, after="config")
    extension.add_function("text of a recording", "tables.text_of_recording")
    extension.add_function("initial.file", "recording.read_starts")
    extension.add_function("log in a file", "recording_check.log_of")
    extension.add_function("reference.smoothing", "smoothing.smoothed_waypoints")
    extension.add_function("proposed smoothing", "smoothing.proposed_smoothing")
    extension.add_function("remarks on waypoints", "smoothing.remarks")
    extension.add_function("show --export", "export_run.export_run")
