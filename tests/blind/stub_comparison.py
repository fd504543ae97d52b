"""A program with the options of `compare` that claims what it is told to.

    python stub_comparison.py DOCUMENT -- (options of compare)

DOCUMENT is the comparison as JSON; `crash` ends the program. It counts the runs that it was given.
"""

import json
import sys
from pathlib import Path

split = sys.argv.index("--")
told, options = sys.argv[1], sys.argv[split + 1 :]
if told == "crash":
    sys.exit("stub: told to crash")
folders = [Path(options[options.index(name) + 1]) for name in ("--before", "--after")]
out = Path(options[options.index("--out") + 1])
out.mkdir()
seen = [sorted(path.name for path in folder.iterdir()) for folder in folders]
document = {**json.loads(told), "seen": seen, "robot": Path(options[options.index("--robot") + 1]).read_text()}
(out / "comparison.json").write_text(json.dumps(document))
print(json.dumps({"compare": document}))
