"""Drawings that become part of the page: inline SVG that follows the page's light or dark colours."""
