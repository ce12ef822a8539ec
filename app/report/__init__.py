"""The report of a job: one printable file with everything that a design review asks for."""

from app.report.page import POLICY, write_report

__all__ = ["POLICY", "write_report"]
