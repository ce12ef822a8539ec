"""The reference of the settings: the fields of the classes that read them."""

from __future__ import annotations

from app.settings import Settings
from ondelette_docs.schemas import cell
from worker.settings import QueueSettings, WorkerSettings


def _table(cls: type[QueueSettings], without: set[str]) -> str:
    rows = ["| variable | what | default |", "|---|---|---|"]
    for name, field in cls.model_fields.items():
        if name not in without:
            default = "none" if field.default in (None, ()) else f"`{field.default}`"
            rows.append(f"| `ONDELETTE_{name.upper()}` | {cell(field.description)} | {cell(default)} |")
    return "\n".join(rows)


def render() -> str:
    """Return the settings of all, of the API and of workers as Markdown."""
    common = set(QueueSettings.model_fields)
    return "\n\n".join(
        [
            "## Of everyone\n",
            _table(QueueSettings, set()),
            "## Of the API\n",
            _table(Settings, common),
            "## Of workers\n",
            _table(WorkerSettings, common),
        ]
    )
