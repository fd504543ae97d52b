"""The learned residual of a diagnosis.json or model.json."""

from residual_mpc.learning.network.residual import KEY, Residual, from_json
from residual_mpc.models.model_file import Written, model_content


def residual_in(written: Written, last: bool = False) -> Residual | None:
    """The learned residual, None where it has none; `last`: only what its last case added.

    Raises BadInput for neither a model nor a diagnosis, and for a residual that cannot be read.
    """
    found = model_content(written).get("last_residual" if last else KEY)
    return None if found is None else from_json(found, written.where)
