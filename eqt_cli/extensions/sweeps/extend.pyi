from eqt_cli.extensions.sweeps.figures import Winners as Winners
