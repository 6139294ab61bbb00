"""How Sphinx builds the documentation; `make docs` runs it strictly and without a network."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import eqt_cli

project = "eqt"
author = "The eqt developers"
copyright = author
version = release = eqt_cli.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "math_as_mathml",
    "docstrings",
    "tables",
    "long_names",
    "toggles",
    "redirects",
    "descriptions",
    "finding",
    "drawings",
    "symbols",
    "offline",
    "live_page",
    "loops",
]

# Pages.
templates_path = ["_templates"]
exclude_patterns = ["paper", "_ext", "_templates", "_static/*.txt", "reference/*.py"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 3
html_math_renderer = "mathml"
toc_object_entries = False

# Docstrings: NumPy style, in which single backticks are code.
default_role = "code"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {
    name: name for name in ("Array", "Arrays", "Configuration", "ResultPath", "Shown")
}
autodoc_preserve_defaults = True
nitpick_ignore_regex = [  # types of parameters and attributes; references stay strict
    ("py:(class|exc)", ".*"),
    ("py:obj", r"typing\.(Annotated|Literal)\[.*"),
]

# What a command prints is not to be copied.
copybutton_selector = "div:not(.highlight-output) > div.highlight > pre"

# Theme; nothing comes from a network.
html_theme = "pydata_sphinx_theme"
html_title = "eqt"
html_static_path = ["_static"]
html_favicon = "_static/favicon.svg"
html_css_files = ["eqt.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {
        "image_light": "_static/favicon.svg",
        "image_dark": "_static/favicon.svg",
        "text": "eqt",
    },
    "header_links_before_dropdown": 5,
    "navigation_with_keys": False,
    "show_nav_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_sidebars = {page: [] for page in ("index", "gallery")}
