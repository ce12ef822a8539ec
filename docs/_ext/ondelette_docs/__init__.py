"""What the site does beyond Sphinx: generated references, formulas as MathML, a tolerant navigation."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from ondelette_docs import command_line, document, http, settings
from ondelette_docs.mathml import install_mathml

GENERATED: dict[str, Callable[[], str]] = {
    "http": http.render,
    "document": document.render,
    "command line": command_line.render,
    "settings": settings.render,
}
"""What may stand in ``<!-- generated: NAME -->``: Markdown made of the code, so that it cannot drift."""

_GENERATED = re.compile(r"^<!-- generated: (.+) -->$", re.MULTILINE)
_REST = "<!-- pages that no list names -->"
_ENTRY = re.compile(r"^(?:.+<)?([\w/-]+)>?$", re.MULTILINE)


def _fill(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put into a page what is generated for it."""
    source[0] = _GENERATED.sub(lambda found: GENERATED[found[1]](), source[0])
    if _REST in source[0]:
        listed = {
            name
            for block in re.findall(r"```\{toctree\}.*?```", source[0], re.DOTALL)
            for name in _ENTRY.findall(block)
        }
        folder = (Path(app.srcdir) / docname).parent
        pages = sorted(page.stem for page in folder.glob("*.md"))
        rest = [page for page in pages if page not in {*listed, Path(docname).name}]
        source[0] = source[0].replace(_REST, "\n".join(rest))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register everything with Sphinx."""
    app.connect("source-read", _fill)
    install_mathml(app)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
