"""Sections, figures and templates that become one self-contained HTML file."""

from residual_mpc.report.evidence.evidence import Evidence, Panel, Windows
from residual_mpc.report.report import compose, write_report
from residual_mpc.report.terminal import diagnosis_lines, gap_lines
from residual_mpc.report.words.summary import sentence

__all__ = [
    "Evidence",
    "Panel",
    "Windows",
    "compose",
    "diagnosis_lines",
    "gap_lines",
    "sentence",
    "write_report",
]
