"""Sections, figures and templates that become one self-contained HTML file."""

from residual_mpc.report.evidence import Evidence, Panel, Windows
from residual_mpc.report.report import compose, write_report
from residual_mpc.report.wording import sentence

__all__ = ["Evidence", "Panel", "Windows", "compose", "sentence", "write_report"]
