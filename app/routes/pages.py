"""What a person sees in a browser: the page, the API's documentation, what a problem type means."""

from __future__ import annotations

import base64
import hashlib
import re

from fastapi import APIRouter, Request, Response
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import HTMLResponse

from app.assets import Assets
from app.errors import ServiceError
from app.openapi import refusals
from app.problems import PROBLEMS

router = APIRouter()


def _digest(text: str) -> str:
    """The hash by which a content security policy allows what stands in the page."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


_PAGE = Assets(
    "app.page",
    "static",
    {
        "index.html": "text/html",
        "app.js": "text/javascript",
        "editor.js": "text/javascript",
        "app.css": "text/css",
        "icon.svg": "image/svg+xml",
        "LICENSES.txt": "text/plain",
    },
)

# Nothing but our own files, and nothing that turns text into markup: what was submitted is always text.
_PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
    "require-trusted-types-for 'script'; trusted-types 'none'"
)

# The files of Swagger UI come with a package, so that the documentation opens where there is no internet, and
# so that nobody else's server is asked.
_SWAGGER = Assets(
    "fastapi_offline",
    "static",
    {
        "swagger-ui-bundle.js": "text/javascript",
        "swagger-ui.css": "text/css",
        "favicon.png": "image/png",
    },
)


@router.get("/", include_in_schema=False)
def page(request: Request) -> Response:
    """Return the page; the rest of its address, behind #, stays in the browser."""
    return _PAGE.answer(request, "index.html", {"Content-Security-Policy": _PAGE_POLICY})


@router.get("/page/{name}", include_in_schema=False)
def part(request: Request, name: str) -> Response:
    """Return a file that the page needs."""
    if name not in _PAGE:
        raise ServiceError("not-found")
    return _PAGE.answer(request, name)


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
def asset(request: Request, name: str) -> Response:
    """Return a file that the documentation needs."""
    if name not in _SWAGGER:
        raise ServiceError("not-found")
    return _SWAGGER.answer(request, name)


@router.get("/problems/{name}", include_in_schema=False, responses=refusals(404))
def problem(name: str) -> Response:
    """Explain a problem type."""
    if name not in PROBLEMS:
        raise ServiceError("not-found", f"The problem types are {', '.join(PROBLEMS)}.")
    kind = PROBLEMS[name]
    return Response(
        f"{kind.title} (HTTP status {kind.status})\n\n{kind.explanation}\n", media_type="text/plain"
    )
