"""Control laws: one file per controller, found by scanning this folder."""

from eqt_cli.controllers.base import Controller as Controller
from eqt_cli.core.registry import Registry

controllers = Registry("controller", __name__, Controller)
