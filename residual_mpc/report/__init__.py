"""Sections, figures and templates that become one self-contained HTML file."""
