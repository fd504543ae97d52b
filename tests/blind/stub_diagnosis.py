"""A program with the options of `diagnose` that looks at all it can reach, and claims what it is told to.

    python stub_diagnosis.py VERDICT [EFFECT TARGET] -- (options of diagnose)

It writes down all that it can see (environment, arguments, every file near it), so that a test can search it.
"""

import json
import os
import sys
from pathlib import Path

split = sys.argv.index("--")
told, options = sys.argv[1:split], sys.argv[split + 1 :]
out = Path(options[options.index("--out") + 1])
if told[0] == "crash":
    sys.exit("stub: told to crash")
if told[0] == "sleep":
    import time

    time.sleep(60)
out.mkdir()
robot = Path(options[options.index("--robot") + 1]).resolve()
seen = [repr(sorted(os.environ.items())), repr(sys.argv), str(Path.cwd())]
for path in sorted(robot.parent.parent.rglob("*")):
    seen.append(str(path))
    if path.is_file():
        seen.append(path.read_bytes().decode("latin-1"))
explanation = []
if len(told) > 1:
    target = None if told[2] == "-" else told[2]
    explanation = [{"effect": told[1], "target": target, "probability": 0.9, "parameters": {}}]
document = {
    "schema": "residual-mpc/diagnosis/1",
    "robot": "stub",
    "verdict": told[0],
    "held_out": [],
    "gap": {"before": 1.0, "after": 0.5, "noise_floor": 0.1, "horizon": 1.0},
    "shrink": None,
    "explanation": explanation,
    "candidates": [],
    "confounded": [],
    "seen": "\n".join(seen),
}
(out / "diagnosis.json").write_text(json.dumps(document))
