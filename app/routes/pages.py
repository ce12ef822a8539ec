"""What a person sees in a browser: the first page, the API's documentation, what a problem type means."""

from __future__ import annotations

import base64
import hashlib
import html
import re
from collections.abc import Mapping
from importlib.resources import files

from fastapi import APIRouter, Request, Response
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import HTMLResponse

from app.errors import ServiceError
from app.openapi import refusals
from app.problems import PROBLEMS

router = APIRouter()

_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:44rem;margin:3rem auto;padding:0 1rem}"
    "pre{background:#f3f4f6;padding:1rem;overflow:auto}dt{font-family:monospace}"
)

_PAGE = f"""<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>ondelette</title>
<style>{_STYLE}</style>
<h1>ondelette</h1>
<p>Solves optimal-control problems by direct methods and verifies every answer by re-integration.</p>
<pre>curl -s HERE/v1/cases/flexible_spacecraft |
  curl -s HERE/v1/jobs -H 'Content-Type: application/json' -H 'Prefer: wait=30' -d @-</pre>
<dl>
<dt><a href="/docs">/docs</a>, <a href="/openapi.json">/openapi.json</a></dt><dd>The interface.</dd>
<dt><a href="/v1/jobs">/v1/jobs</a></dt><dd>Jobs, newest first; POST a document here.</dd>
<dt><a href="/v1/cases">/v1/cases</a></dt><dd>Ready documents with their reference answers.</dd>
<dt><a href="/v1/methods">/v1/methods</a></dt><dd>Methods with their defaults.</dd>
<dt><a href="/v1/models">/v1/models</a></dt><dd>Library models.</dd>
<dt><a href="/readyz">/readyz</a></dt><dd>Whether the broker answers and a worker is alive.</dd>
<dt><a href="/metrics">/metrics</a></dt><dd>Numbers for Prometheus.</dd>
</dl>
</html>
"""


def _digest(text: str) -> str:
    """The hash by which a content security policy allows what stands in the page."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


_PAGE_POLICY = f"default-src 'none'; style-src 'sha256-{_digest(_STYLE)}'; frame-ancestors 'none'"

# The files of Swagger UI come with a package, so that the documentation opens where there is no internet, and
# so that nobody else's server is asked.
_ASSETS: Mapping[str, str] = {
    "swagger-ui-bundle.js": "text/javascript",
    "swagger-ui.css": "text/css",
    "favicon.png": "image/png",
}


@router.get("/", include_in_schema=False)
def page(request: Request) -> HTMLResponse:
    """Return the first page."""
    text = _PAGE.replace("HERE", html.escape(str(request.base_url).rstrip("/")))
    return HTMLResponse(text, headers={"Content-Security-Policy": _PAGE_POLICY})


@router.get("/docs", include_in_schema=False)
def docs(request: Request) -> HTMLResponse:
    """Return the API's documentation."""
    answer = get_swagger_ui_html(
        openapi_url="/openapi.json",
        title=f"{request.app.title}: the interface",
        swagger_js_url="/docs/swagger-ui-bundle.js",
        swagger_css_url="/docs/swagger-ui.css",
        swagger_favicon_url="/docs/favicon.png",
    )
    # The one script that stands in the page itself, and those from here.
    script = re.search(r"<script>(.*?)</script>", bytes(answer.body).decode(), re.DOTALL)
    assert script is not None
    answer.headers["Content-Security-Policy"] = (
        f"default-src 'none'; connect-src 'self'; img-src 'self' data:; style-src 'self' 'unsafe-inline'; "
        f"script-src 'self' 'sha256-{_digest(script[1])}'; frame-ancestors 'none'"
    )
    return answer


@router.get("/docs/{name}", include_in_schema=False)
def asset(name: str) -> Response:
    """Return a file that the documentation needs."""
    if name not in _ASSETS:
        raise ServiceError("not-found")
    content = (files("fastapi_offline") / "static" / name).read_bytes()
    return Response(content, media_type=_ASSETS[name], headers={"Cache-Control": "max-age=86400"})


@router.get("/problems/{name}", include_in_schema=False, responses=refusals(404))
def problem(name: str) -> Response:
    """Explain a problem type."""
    if name not in PROBLEMS:
        raise ServiceError("not-found", f"The problem types are {', '.join(PROBLEMS)}.")
    kind = PROBLEMS[name]
    return Response(
        f"{kind.title} (HTTP status {kind.status})\n\n{kind.explanation}\n", media_type="text/plain"
    )
