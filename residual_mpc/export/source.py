"""Which robot a written model is of."""

from collections.abc import Mapping
from importlib.metadata import entry_points
from pathlib import Path

from residual_mpc.errors import BadInput
from residual_mpc.models.load import GROUP


def robot_beside(document: Mapping[str, object], file: Path) -> str:
    """The robot file that the model was made with, or the robot's name where it is built in."""
    inner = document.get("model")
    model = inner if isinstance(inner, dict) else document
    beside = model.get("robot_file")
    if isinstance(beside, str):
        path = file.parent / beside
        if path.is_file():
            return str(path)
    name = str(model.get("robot", ""))
    if name in {e.name for e in entry_points(group=GROUP)}:
        return name
    if not name:
        raise BadInput("the file is neither a model nor a diagnosis", str(file), "give model.json or diagnosis.json")
    raise BadInput(f"it is a model of {name!r}, whose robot file was not found", str(file), "give the file as `robot`")
