"""MuJoCo's log, which goes to the terminal and to a file in the user's folder unless it is told not to."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache


@cache
def silence_mujoco() -> None:
    """Switch off MuJoCo's own console and file log in this process, once; to be called before anything is simulated.

    Simulations that run away are what a diagnosis tries all the time, and are told from the states that they reach.
    Errors of MuJoCo are exceptions with or without its log. A handler that the user has set still gets its messages.
    """
    import mujoco

    config = mujoco.MjLogConfig.get()
    config.logto_console = config.logto_file = False
    config.set()


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """What MuJoCo warns of inside the block, each text once; a handler that the user has set gets all of it as well."""
    import mujoco

    messages: list[str] = []
    before = mujoco.get_mju_user_warning()

    def collect(text: str) -> None:
        plain = " ".join(text.split())
        if plain not in messages:
            messages.append(plain)
        if before is not None:
            before(text)

    mujoco.set_mju_user_warning(collect)
    try:
        yield messages
    finally:
        mujoco.set_mju_user_warning(before)
