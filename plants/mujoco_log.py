"""MuJoCo's log, which goes to the terminal and to a file in the user's folder unless it is told not to."""

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
