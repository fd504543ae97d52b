"""The page's script: only the parts that its sections ask for, and the policy that lets no other script run."""

import base64
import hashlib
from collections.abc import Sequence

from residual_mpc.report.sections.section import Section, environment

SHARED = "plots.js"


def program(sections: Sequence[Section]) -> str:
    """One text for all sections; empty where none has a script."""
    wanted = [section.script for section in sections if section.script]
    return "\n".join(_source(name) for name in (SHARED, *wanted)) if wanted else ""


def allowed(text: str) -> str:
    """The part of a content security policy that admits this script alone; empty for none."""
    return f"script-src 'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" if text else ""


def _source(name: str) -> str:
    loader = environment().loader
    assert loader is not None
    return loader.get_source(environment(), name)[0].strip()
