from eqt_cli.extensions.citations.citations import cite as cite
