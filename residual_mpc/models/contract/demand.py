"""How a check of a robot's contract fails."""


class ContractBroken(Exception):
    """A robot does not keep the contract of `residual_mpc.models.protocol.Robot`.

    Args:
        law: the law that is broken, as a sentence without its full stop.
        came: what the robot did or returned.
        wanted: what was wanted instead.
    """

    def __init__(self, law: str, came: object, wanted: object) -> None:
        super().__init__(law, came, wanted)
        self.law = law
        self.came = came
        self.wanted = wanted

    def __str__(self) -> str:
        return f"{self.law}: expected {self.wanted}, got {self.came}"


def demand(holds: bool, law: str, came: object, wanted: object) -> None:
    """Raises ContractBroken unless the law holds."""
    if not holds:
        raise ContractBroken(law, came, wanted)
