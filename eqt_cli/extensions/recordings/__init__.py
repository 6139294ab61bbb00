"""Recordings of flights: ULog, checks, fits, replays, and a recording beside a run."""

COMPONENTS = {"controllers": {"replay": "prediction"}, "figures": {"measured": "figures"}}

COMMANDS = {
    "replay": ("commands.replay", "worst", "model.yaml --measured flown.csv"),
    "fit": ("commands.fit", "replay", "model.yaml --measured flown.csv --over plant.inertia"),
    "log": ("commands.log_app", "config", ""),
}

FORMATS_BY_SUFFIX = {".ulg": "ulog", ".bin": "dataflash"}
FORMATS_BY_SUFFIX |= dict.fromkeys((".bag", ".mcap", ".db3"), "bag")
RECORDINGS = "tables"
