"""The report of a result: one HTML file that needs nothing but a browser.

This package is the only importer of jinja2.
"""

from eqt_cli.report.document import report

__all__ = ["report"]
