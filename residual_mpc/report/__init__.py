"""Sections, figures and templates that become one self-contained HTML file."""

from residual_mpc.report.evidence import ChannelGap, Evidence, Panel, WindowGaps
from residual_mpc.report.report import compose, write_report

__all__ = ["ChannelGap", "Evidence", "Panel", "WindowGaps", "compose", "write_report"]
