"""`make blind`: a development sweep of the blind benchmark into build/blind/; a second call carries on.

python -m benchmarks.blind [--cases N] [--family F] [--level L] [--out FOLDER] [--jobs J] [--no-baselines]
"""

from residual_mpc.blind.sweep import sweep

CASES = 20  # of each family at each level

if __name__ == "__main__":
    sweep.main(default_map={"cases": CASES})
