"""Laws as C for firmware, and C of others as laws that are judged."""

COMPONENTS = {"controllers": {"code": "controllers"}}

COMMANDS = {"export": ("commands.export", "pack", "configs/paper.yaml --controller eqt --out law")}
