"""The command line for a process of its own, with reports whose films are a few frames long: a whole film takes longer
than a small diagnosis."""

PROGRAM = """
import sys
from residual_mpc.cli.main import main
from residual_mpc.report.motion import film
film.FRAMES, film.LONG_FRAMES = 3, 5
main(sys.argv[1:])
"""
