"""Recognise formats other than CSV and Parquet by a file's first bytes; say how to convert those that are not read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from residual_mpc.errors import BadInput

ENOUGH = 1024  # bytes by which a format is recognised


@dataclass(frozen=True)
class Format:
    """name: with its article. remedy: how to make a table of such a file; empty for a format that is read."""

    name: str
    remedy: str = ""

    def refusal(self, path: Path) -> BadInput:
        return BadInput(f"must be a run in a format that is read, got {self.name}", str(path), self.remedy)


# Formats that are read, which need no remedy.
MCAP = Format("an MCAP recording")
BAG = Format("a ROS 1 bag")
BAG2 = Format("a ROS 2 bag (SQLite)")
HDF5 = Format("an HDF5 file")
MATLAB = Format("a MATLAB file")
NPZ = Format("a NumPy archive")

SQLITE = Format("an SQLite database", "write the run to a table, for example pandas.read_sql(...).to_csv('run.csv')")
NPY = Format(
    "a NumPy array",
    "name its columns and write a table, with pandas: DataFrame(numpy.load(...), columns=[...]).to_csv('run.csv')",
)
PICKLE = Format(
    "a Python pickle",
    "if you trust it, read it with pandas.read_pickle and write a table: frame.to_parquet('run.parquet')",
)
SPREADSHEET = Format(
    "a spreadsheet", "save the sheet as CSV, or convert it with pandas: read_excel(...).to_csv('run.csv', index=False)"
)
ARROW = Format("an Arrow (Feather) file", "with pandas: read_feather(...).to_parquet('run.parquet')")
ARCHIVE = Format("a compressed archive", "unpack it and give the tables in it; a CSV file may be gzip-compressed")
PX4 = Format("a PX4 log", "convert it with ulog2csv from the Python package pyulog, and join the topics into one table")
JSON = Format("a JSON file", "with pandas: read_json(...).to_csv('run.csv', index=False); lines=True for JSON lines")
UNKNOWN = Format(
    "a binary file of an unknown format", "export the run as CSV or Parquet from the program that wrote it"
)

MAGIC = (
    (b"\x89MCAP0\r\n", MCAP),
    (b"#ROSBAG V", BAG),
    (b"\x89HDF\r\n\x1a\n", HDF5),
    (b"MATLAB ", MATLAB),
    (b"\x93NUMPY", NPY),
    *((bytes([0x80, protocol]), PICKLE) for protocol in range(2, 6)),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", SPREADSHEET),
    (b"ARROW1", ARROW),
    (b"FEA1", ARROW),
    (b"ULog\x01\x12\x35", PX4),
    (b"7z\xbc\xaf\x27\x1c", ARCHIVE),
    (b"\x28\xb5\x2f\xfd", ARCHIVE),  # Zstandard
    (b"BZh", ARCHIVE),
    (b"\xfd7zXZ\x00", ARCHIVE),
    (b"\x04\x22\x4d\x18", ARCHIVE),  # LZ4
    (b"Rar!\x1a\x07", ARCHIVE),
)
BY_SUFFIX = {
    ".mcap": MCAP,
    ".bag": BAG,
    ".h5": HDF5,
    ".hdf5": HDF5,
    ".mat": MATLAB,
    ".pkl": PICKLE,
    ".pickle": PICKLE,
    ".xls": SPREADSHEET,
    ".ulg": PX4,
}


def recognise(start: bytes, name: str) -> Format | None:
    """The format of a file that begins like this; None for text and for unknown formats.

    Args:
        start: its first bytes, `ENOUGH` of them.
        name: the file's.
    """
    suffix = Path(name).suffix.lower()
    for magic, found in MAGIC:
        if start.startswith(magic):
            return found
    if start.startswith(b"SQLite format 3\x00"):
        return BAG2 if suffix == ".db3" else SQLITE
    if start.startswith(b"PK\x03\x04"):
        return _zipped(start, suffix)
    if start[257:262] == b"ustar":
        return ARCHIVE
    if suffix in (".json", ".jsonl", ".ndjson") or start.lstrip().startswith((b'{"', b"[{")):
        return JSON
    return BY_SUFFIX.get(suffix) if b"\x00" in start else None


def recognise_file(path: Path) -> Format | None:
    """The format of a file; None for a table, and for what cannot be read."""
    try:
        with open(path, "rb") as file:
            return recognise(file.read(ENOUGH), path.name)
    except OSError:
        return None


def _zipped(start: bytes, suffix: str) -> Format:
    if suffix == ".npz" or b".npy" in start[:300]:
        return NPZ
    if suffix in (".xlsx", ".xlsm", ".ods") or b"[Content_Types].xml" in start[:300]:
        return SPREADSHEET
    return ARCHIVE
