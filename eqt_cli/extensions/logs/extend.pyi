"""What the extension adds to `eqt_cli.extend`."""

from eqt_cli.extensions.logs.recording_check import LogReference as LogReference
