"""The site of the documentation (``make docs``): Markdown in, static pages out, nothing from elsewhere."""

from __future__ import annotations

import sys
from importlib.metadata import version as installed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "ondelette"
author = "the ondelette authors"
version = release = installed("ondelette")
extensions = ["myst_parser", "ondelette_docs"]
exclude_patterns = ["_ext"]

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4
nitpicky = True
html_show_copyright = False

html_theme = "furo"
html_title = f"ondelette {release}"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["ondelette.css"]
html_theme_options = {"top_of_page_buttons": []}
# Fragments of documents are shown as JSON although they are parts of it.
suppress_warnings = ["misc.highlighting_failure"]
