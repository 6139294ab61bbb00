from eqt_cli.extensions.live.api import live as live
