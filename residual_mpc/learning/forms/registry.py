"""The forms that can be replayed, by name."""

from residual_mpc.errors import BadInput
from residual_mpc.learning.forms.body import POSE, BodyForm, PaperForm
from residual_mpc.learning.forms.form import Form
from residual_mpc.learning.forms.joint import JointForm
from residual_mpc.models.protocol import Robot


def form_named(name: str) -> Form:
    """The form of a record. Raises BadInput for a name that no form has."""
    known: dict[str, Form] = {f.name: f for f in (BodyForm(), PaperForm(), JointForm())}
    if name not in known:
        raise BadInput(f"a residual of form {name!r} cannot be simulated", "", f"forms that can: {', '.join(known)}")
    return known[name]


def default_form(base: Robot) -> Form:
    """The body form for a robot that drives on a plane, else the joint form."""
    return form_named("body" if _drives(base) else "joint")


def check_form(name: str, base: Robot) -> None:
    """Raises BadInput for a form that corrects velocities which the robot does not have."""
    if (name == "joint") != _drives(base):
        return
    kind, fit = ("joint velocities", "body or paper") if name == "joint" else ("a planar velocity", "joint")
    raise BadInput(
        f"the form {name!r} corrects {kind}, which {base.name!r} does not have", "`form`",
        f"give {fit}, or leave it out",
    )  # fmt: skip


def _drives(base: Robot) -> bool:
    """Whether a robot has a pose on the plane."""
    return set(POSE) <= {s.position for s in base.states}
