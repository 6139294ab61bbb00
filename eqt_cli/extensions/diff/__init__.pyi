from eqt_cli.extensions.diff.diff import diff as diff
