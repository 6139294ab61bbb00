"""The HTML page of a result; nothing else but the export of laws imports jinja2."""
