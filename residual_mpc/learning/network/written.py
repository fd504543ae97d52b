"""The learned residual of a diagnosis.json or model.json."""

from residual_mpc.errors import BadInput
from residual_mpc.learning.network.residual import KEY, Residual, from_json
from residual_mpc.models.model_file import Written, model_content


def residual_in(written: Written, last: bool = False) -> Residual | None:
    """The learned residual, None where it has none; `last`: only what its last case added.

    Raises BadInput for neither a model nor a diagnosis, and for a residual that cannot be read.
    """
    found = model_content(written).get(f"last_{KEY}" if last else KEY)
    return None if found is None else from_json(found, written.where)


def kept_nothing(written: Written) -> bool:
    """Whether `learn` wrote it and kept no network. Raises BadInput as `residual_in` does."""
    model = model_content(written)
    return "case" in model and f"last_{KEY}" in model and model[f"last_{KEY}"] is None


def residual_for(written: Written, robot: str) -> Residual | None:
    """As `residual_in`. Raises BadInput for a network of another robot."""
    residual = residual_in(written)
    if residual is not None and residual.robot != robot:
        raise BadInput(
            f"its residual must be of {robot}, got one of {residual.robot}",
            written.where,
            "give the robot file that was used for learning",
        )
    return residual


def network_in(written: Written) -> tuple[str, ...]:
    """What a table of numbers leaves out of such a model: its network, if it has one."""
    return () if residual_in(written) is None else ("the learned network, which a table cannot hold",)
