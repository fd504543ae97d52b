"""A file of another format is called by its name, and the message says how to make a table of it."""

from __future__ import annotations

import gzip
import io
import json
import pickle
import sqlite3
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from run_tables import ROBOT

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.read import read_runs


def refusal(path: Path) -> BadInput:
    with pytest.raises(BadInput) as raised:
        read_runs([path], ROBOT)
    return raised.value


@pytest.mark.parametrize(
    ("name", "content", "format", "remedy"),
    [
        ("a.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(50), "a spreadsheet", "as CSV"),
        ("a.feather", b"ARROW1\x00\x00" + bytes(50), "an Arrow (Feather) file", "read_feather"),
        ("a.7z", b"7z\xbc\xaf\x27\x1c" + bytes(50), "a compressed archive", "unpack"),
        ("a.csv.zst", b"\x28\xb5\x2f\xfd" + bytes(50), "a compressed archive", "unpack"),
        ("a.ulg", b"ULog\x01\x12\x35\x01" + bytes(50), "a PX4 log", "ulog2csv"),
        ("a.json", b'{"t": [0.0, 0.1]}\n', "a JSON file", "read_json"),
        ("a.jsonl", b'{"t": 0.0}\n{"t": 0.1}\n', "a JSON file", "lines=True"),
    ],
)
def test_it_is_called_by_its_name(tmp_path: Path, name: str, content: bytes, format: str, remedy: str) -> None:
    (tmp_path / name).write_bytes(content)
    fault = refusal(tmp_path / name)
    assert fault.what == f"must be a run in a format that is read, got {format}"
    assert remedy in fault.remedy and name in fault.where


def test_files_that_programs_wrote(tmp_path: Path) -> None:
    columns = {"t": np.arange(5.0), "position.a": np.zeros(5)}
    np.save(tmp_path / "a.npy", columns["t"])
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(columns))
    with sqlite3.connect(tmp_path / "a.sqlite") as base:
        base.execute("create table messages (id integer)")
    with zipfile.ZipFile(tmp_path / "a.xlsx", "w") as archive:
        archive.writestr("xl/workbook.xml", "<workbook/>")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("run.csv", "t\n0\n")
    with tarfile.open(tmp_path / "a.tar.gz", "w:gz") as archive_of_tables:
        archive_of_tables.addfile(tarfile.TarInfo("run.csv"), io.BytesIO())
    for name, format in {
        "a.npy": "a NumPy array",
        "a.pkl": "a Python pickle",
        "a.sqlite": "an SQLite database",
        "a.xlsx": "a spreadsheet",
        "a.zip": "a compressed archive",
        "a.tar.gz": "a compressed archive",
    }.items():
        fault = refusal(tmp_path / name)
        assert fault.what.endswith(f", got {format}") and fault.remedy, name


def test_a_binary_file_that_nobody_knows(tmp_path: Path) -> None:
    (tmp_path / "a.dat").write_bytes(bytes(range(256)))
    assert "got a binary file of an unknown format" in refusal(tmp_path / "a.dat").what


def test_a_compressed_table_is_still_a_table(tmp_path: Path) -> None:
    lines = ["t,command.left,command.right,pose.x", *(f"{0.1 * k},1,1,{k}" for k in range(9))]
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress("\n".join(lines).encode()))
    assert len(read_runs([tmp_path / "a.csv.gz"], ROBOT).runs) == 1


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.mcap", b"\x89MCAP0\r\n" + bytes(50)),
        ("a.bag", b"#ROSBAG V2.0\n" + bytes(50)),
        ("a.db3", b"SQLite format 3\x00" + bytes(50)),
        ("a.h5", b"\x89HDF\r\n\x1a\n" + bytes(50)),
        ("a.mat", b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x01IM" + bytes(64)),
        ("v73.mat", b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n"),
        ("odd.csv", b"\x89MCAP0\r\n" + bytes(50)),
        ("run.parquet", b"\x89HDF\r\n\x1a\n" + bytes(50)),
        ("a.npz", b"PK\x03\x04" + bytes(50)),
    ],
)
def test_a_damaged_file_of_a_format_that_is_read_is_refused(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    fault = refusal(tmp_path / name)
    assert name in fault.where and fault.remedy, fault


def test_a_folder_says_what_it_holds_instead(tmp_path: Path) -> None:
    (tmp_path / "flights").mkdir()
    (tmp_path / "flights" / "a.ulg").write_bytes(b"ULog\x01\x12\x35\x01" + bytes(50))
    fault = refusal(tmp_path / "flights")
    assert "a.ulg is a PX4 log" in fault.what and "ulog2csv" in fault.remedy


def test_a_data_set_without_tables_says_where_they_would_be(tmp_path: Path) -> None:
    (tmp_path / "set" / "meta").mkdir(parents=True)
    (tmp_path / "set" / "data").mkdir()
    (tmp_path / "set" / "meta" / "info.json").write_text(json.dumps({"codebase_version": "v3.0", "features": {}}))
    assert "data/chunk-*/*.parquet" in refusal(tmp_path / "set").remedy
