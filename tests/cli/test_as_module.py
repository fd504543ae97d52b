"""The command is there without its script, too."""

import subprocess
import sys


def test_the_package_runs_as_the_command() -> None:
    done = subprocess.run([sys.executable, "-m", "residual_mpc", "gap", "nothing.csv"], capture_output=True, text=True)
    assert done.returncode == 2 and "--robot" in done.stderr and "Traceback" not in done.stderr
