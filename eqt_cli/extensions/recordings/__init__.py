"""Recordings of flights: ULog, checks, fits, replays, and a recording beside a run."""

from eqt_cli.base.extensions import COMPUTE, LOOK_UP, Extension

FORMATS_BY_SUFFIX = {".ulg": "ulog", ".bin": "dataflash"}
FORMATS_BY_SUFFIX |= dict.fromkeys((".bag", ".mcap", ".db3"), "bag")


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_component("controllers", "replay", "prediction")
    extension.add_component("references", "log", "recording_check")
    extension.add_component("figures", "measured", "figures")
    of_replay = "model.yaml --measured flown.csv"
    extension.add_command("replay", "commands.replay", COMPUTE, of_replay, after="compare")
    of_fit = f"{of_replay} --over plant.inertia"
    extension.add_command("fit", "commands.fit", COMPUTE, of_fit, after="replay")
    extension.add_command("log", "commands.log_app", LOOK_UP, after="config")
    extension.add_function("text of a recording", "tables.text_of_recording")
    extension.add_function("initial.file", "recording.read_starts")
    extension.add_function("log in a file", "recording_check.log_of")
    extension.add_function("reference.smoothing", "smoothing.smoothed_waypoints")
    extension.add_function("proposed smoothing", "smoothing.proposed_smoothing")
    extension.add_function("remarks on waypoints", "smoothing.remarks")
    extension.add_function("plot --measured", "api.read_measured")
    extension.add_function("compare --measured", "api.compare_measured")
    extension.add_function("findings on a recording", "measured.findings")
    extension.add_function("show --export", "export_run.export_run")
