from eqt_cli.extensions.code.call_times import call_times as call_times
