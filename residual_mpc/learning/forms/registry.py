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
    return form_named("body" if set(POSE) <= {s.position for s in base.states} else "joint")


def check_form(name: str, base: Robot) -> None:
    """Raises BadInput for a form that corrects velocities which the robot does not have."""
    positions = {s.position for s in base.states}
    drives, joints = set(POSE) <= positions, any(p.startswith("position.") for p in positions)
    fit = [*(("body", "paper") if drives else ()), *(("joint",) if joints else ())]
    if name not in fit:
        kind = "joint velocities" if name == "joint" else "a planar velocity"
        raise BadInput(
            f"the form {name!r} corrects {kind}, which {base.name!r} does not have", "--form",
            f"give one of {', '.join(fit)}, or leave it out",
        )  # fmt: skip
