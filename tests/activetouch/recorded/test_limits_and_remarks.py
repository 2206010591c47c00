"""What the readers of recorded touches say about features, which numbers they take, and what they refuse to unpack."""

import gzip
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from activetouch.errors import BadRecording
from activetouch.recorded import check_recorded, read_recorded
from belief import columns

NOISE = np.random.default_rng(0).normal(size=(12, 2))


def write_bts3(folder, cell="0.5"):
    rows = [",".join(["object", "slipped", *(f"ff_{i}" for i in range(72))])]
    rows += [",".join(["mug", "0", cell, *["1.5"] * 71])]
    for pose in ("down", "45", "side"):
        (folder / f"bts3v2_palm_{pose}.csv").write_text("\n".join(rows))


def write_npz_sessions(folder, cell="1"):
    np.savez(folder / "a.npz", features=NOISE[:2], object=np.array(["mug", "can"]), session=np.array([cell, "2"]))


def write_csv_feature(folder, cell="1"):
    (folder / "a.csv").write_text(f"object,session,x\nmug,1,{cell}\nmug,2,7\n")


def write_csv_session(folder, cell="1"):
    (folder / "a.csv").write_text(f"object,session,x\nmug,{cell},5\nmug,2,7\n")


WRITERS = {
    "bts3": ("bts3", write_bts3),
    "npz session": ("npz", write_npz_sessions),
    "csv feature": ("csv", write_csv_feature),
    "csv session": ("csv", write_csv_session),
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("cell", ["1_0", " \u0661\u0662", "\uff11", "0x1", "1d0", "\u22121", "1,5"])
def test_only_decimal_numbers_are_numbers_in_every_format(name, cell, tmp_path):
    format_name, write = WRITERS[name]
    write(tmp_path)
    assert read_recorded(tmp_path, format_name)[0].num_touches > 0
    shutil.rmtree(tmp_path)
    tmp_path.mkdir()
    write(tmp_path, cell)
    with pytest.raises(BadRecording, match=r"number|cells"):
        read_recorded(tmp_path, format_name)


@pytest.mark.parametrize("cell", ["infinity", "nan", "-inf", "NaN", "1e999"])
@pytest.mark.parametrize("name", ["csv feature", "csv session", "npz session", "bts3"])
def test_what_is_not_finite_is_refused_by_place(name, cell, tmp_path):
    format_name, write = WRITERS[name]
    write(tmp_path, cell)
    with pytest.raises(BadRecording, match=r"finite|whole number"):
        read_recorded(tmp_path, format_name)


@pytest.mark.parametrize("name", WRITERS)
def test_the_features_that_were_read_are_counted_and_named(name, tmp_path):
    format_name, write = WRITERS[name]
    write(tmp_path)
    touches, notes = read_recorded(tmp_path, format_name)
    assert notes[0].startswith(f"{touches.features.shape[1]} features")
    assert touches.feature_names == () or len(touches.feature_names) == touches.features.shape[1]
    assert all(said in notes[0] for said in touches.feature_names[:8])


def write_labelled(folder, extra="session,label,trial,f1,f2"):
    rows = [f"o{i // 4},{i % 4},{7 * (i // 4)},{10 + i % 4},{NOISE[i, 0]},{NOISE[i, 1]}" for i in range(12)]
    (folder / "a.csv").write_text("\n".join([f"object,{extra}", *rows]) + "\n")


def test_a_feature_that_names_the_object_or_numbers_the_session_is_said_by_name(tmp_path):
    write_labelled(tmp_path)
    touches, notes = read_recorded(tmp_path, "csv")
    assert notes[0] == "4 features: label, trial, f1, f2"
    said = check_recorded(touches)
    assert said[0].startswith("these features name the object: label. They are equal in all touches of an object and")
    assert said[1].startswith("these features number the session: trial. They are equal in all touches of a session")


@pytest.mark.parametrize("name", WRITERS)
def test_a_pipe_among_recordings_is_refused_in_every_format(name, tmp_path):
    format_name, write = WRITERS[name]
    write(tmp_path)
    for path in [path for path in tmp_path.rglob("*") if path.is_file()]:
        path.unlink()
        os.mkfifo(path)
    with pytest.raises(BadRecording, match="is a pipe, not a regular file"):
        read_recorded(tmp_path, format_name)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("limit", ["MOST_ROWS", "MOST_NUMBERS"])
def test_a_set_with_more_than_the_limit_is_refused_in_every_format(name, limit, tmp_path, monkeypatch):
    format_name, write = WRITERS[name]
    write(tmp_path)
    num_touches, num_features = read_recorded(tmp_path, format_name)[0].features.shape
    size = num_touches if limit == "MOST_ROWS" else num_touches * num_features
    monkeypatch.setattr(columns, limit, size)
    read_recorded(tmp_path, format_name)
    monkeypatch.setattr(columns, limit, size - 1)
    with pytest.raises(BadRecording, match=r"holds? more than"):
        read_recorded(tmp_path, format_name)


def test_a_bomb_is_left_where_the_limit_is_reached(tmp_path, monkeypatch):
    monkeypatch.setattr(columns, "MOST_ROWS", 500)
    for row, words in (
        (b"mug,0\n", "holds more than 500 rows"),
        (b"\n", "characters or 1000 lines when decompressed"),
    ):
        content = gzip.compress(b"object,x\n" + row * 100_000)
        (tmp_path / "a.csv.gz").write_bytes(content)
        with pytest.raises(BadRecording, match=words):
            read_recorded(tmp_path, "csv")
    assert len(content) < 1000


def test_a_long_line_is_refused_before_it_is_whole_in_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(columns, "_LONGEST_LINE", 100)
    Path(tmp_path / "a.csv").write_text("object,x\nmug," + "1" * 100 + "\n")
    with pytest.raises(BadRecording, match=r"line 2 of .*a\.csv has more than 100 characters"):
        read_recorded(tmp_path, "csv")
