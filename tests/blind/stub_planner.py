"""A program with the options of `excite` that looks at all it can reach, and plans a second of standing still."""

import json
import os
import sys
from pathlib import Path

options = sys.argv[1:]
seen = [repr(sorted(os.environ.items())), repr(sys.argv), str(Path.cwd())]
for path in sorted(Path.cwd().parent.glob(Path.cwd().name + "/**/*")):
    seen.append(str(path))
    if path.is_file():
        seen.append(path.read_bytes().decode("latin-1"))
Path(options[options.index("--out") + 1]).write_text("t,command.left,command.right\n0,0,0\n1,0,0\n")
print(json.dumps({"excite": {"sensors": ["velocity.left"], "seen": "\n".join(seen)}}))
