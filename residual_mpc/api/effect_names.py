"""Effects that a user names: whether they exist, and whether the robot can have them."""

from collections.abc import Iterable, Sequence

from residual_mpc.effects.laws import FITTED_LAW
from residual_mpc.effects.library import BY_NAME, LIBRARY
from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import did_you_mean
from residual_mpc.models.protocol import Robot

KNOWN = (*(e.name for e in LIBRARY), FITTED_LAW)  # names that `only` and `without` take


def effect_names(names: Iterable[str], option: str) -> tuple[str, ...]:
    """The names. Raises BadInput for one that is no effect."""
    names = (names,) if isinstance(names, str) else tuple(names)
    for name in names:
        if name not in KNOWN:
            raise BadInput(f"unknown effect {name!r}", option, did_you_mean(name, KNOWN))
    return names


def possible_effects(names: Iterable[str], option: str, models: Sequence[Robot]) -> tuple[str, ...]:
    """The names of effects to look for. models: the robot's, one or more, that the runs were recorded with.

    Raises BadInput for one that is no effect, or where none of the models can have any of them.
    """
    names = effect_names(names, option)
    possible = [e.name for e in LIBRARY if any(model.slots(e.name) for model in models)]
    if names and not any(name == FITTED_LAW or name in possible for name in names):
        reasons = [f"{name!r}" + (f" ({BY_NAME[name].lacking})" if BY_NAME[name].lacking else "") for name in names]
        what = f"{models[0].name} cannot have the effect{'s' if len(names) > 1 else ''} {', '.join(reasons)}"
        raise BadInput(what, option, f"the effects that it can have are {', '.join([*possible, FITTED_LAW])}")
    return names
