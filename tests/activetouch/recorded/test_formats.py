"""Formats of recorded touches: what is read, what is refused and said, and that nothing in a file runs or explodes."""

import gzip
import io
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from activetouch.errors import BadRecording
from activetouch.recorded import read_recorded

BTS3 = Path(__file__).parents[2] / "fixtures" / "bts3"


def test_bts3_has_its_objects_poses_and_licence():
    touches, _ = read_recorded(BTS3, "bts3")
    assert (touches.num_touches, len(touches.object_names), touches.num_actions) == (4682, 41, 3)
    assert touches.features.shape[1] == 72  # whether it slipped is not among them
    assert touches.licence == "MIT"
    assert "MIT License" in (BTS3 / "LICENSE").read_text()


HEADER = "object,action,session,category,x,y\n"


def write_csv(folder, text, name="touches.csv"):
    (folder / name).write_text(text)


def test_a_csv_gives_objects_actions_and_sessions(tmp_path):
    write_csv(tmp_path, HEADER + "mug,press,1,cup,1,2\nmug,rub,1,cup,3,4\n")
    write_csv(tmp_path, HEADER + "can,press,2,tin,5,6\n", "more.csv")
    touches, _ = read_recorded(str(tmp_path), "csv")
    assert touches.object_names == ("can", "mug")
    assert touches.action_names == ("press", "rub")
    assert touches.for_task("categories").label_names == ("cup", "tin")
    assert touches.for_task("categories").labels.tolist() == [1, 0, 0]
    assert touches.features.tolist() == [[5.0, 6.0], [1.0, 2.0], [3.0, 4.0]]
    assert touches.sessions.tolist() == [2, 1, 1]


@pytest.mark.parametrize("sign", [";", "\t"])
@pytest.mark.parametrize("point", [".", ","])
def test_spreadsheets_that_write_semicolons_tabs_or_decimal_commas_are_read(tmp_path, sign, point):
    rows = "object,session,x,y\nmug,1,0.5,-1.25e3\n\ncan,2,7,.5\n"
    write_csv(tmp_path, "\n" + rows.replace(",", sign).replace(".", point))
    touches, _ = read_recorded(tmp_path, "csv")
    assert touches.object_names == ("can", "mug")
    assert touches.features.tolist() == [[0.5, -1250.0], [7.0, 0.5]]


def test_files_with_other_columns_say_which(tmp_path):
    write_csv(tmp_path, "object,x,y\nmug,1,2\n", "a.csv")
    for header, words in (("object,x,z", "also 'z', and not 'y'"), ("object,y,x", "the same in another order")):
        write_csv(tmp_path, f"{header}\nmug,1,2\n", "b.csv")
        with pytest.raises(BadRecording, match=f"b.csv has other columns than .*a.csv: {words}"):
            read_recorded(tmp_path, "csv")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "must name the columns"),
        ("thing,x\nmug,1\n", "with 'object' among them"),
        ("object;x\nmug;0,5\nmug;0.5\n", "line 3: numbers have a decimal point, as 0.5, and a decimal comma, as 0,5"),
        ("object;x\nmug;1.234,5\n", "'1.234,5', no number .decimals have a point"),
        ("object,sesion,x\nmug,1,1\n", "has a column 'sesion'. Did you mean 'session'. Rename it"),
        ("object,acton,x\nmug,1,1\n", "Did you mean 'action'"),
        ("object,Session,x\nmug,1,1\n", "Did you mean 'session'"),
        (",object,x\n0,mug,1\n1,mug,2\n", r"column 1 of .*touches.csv has no name.*to_csv\(index=False\)"),
        ('object,x\nmug,"0,5"\n', "'0,5', no number .decimals have a point"),
        ("object,x\nmug\n", "line 2 of .* has 1 cells, the header has 2"),
        ("object,x\nmug,hot\n", "line 2 .*'x' is 'hot'"),
        ("object,x\nmug,1\n,1\n", "line 3 of .*touches.csv names no object"),
        ("object,session,x\nmug,1,1\nmug,soon,1\n", "line 3 of .*: the session is 'soon'; it must be a whole number"),
        ("object,x,pressure\nmug,1,1\n\nmug,2,inf\n", "line 4 .*'pressure' is 'inf', not finite .leave the line out"),
        ("object,category,x\nmug,cup,1\nmug,tin,1\n", "line 3 .*two of category: 'tin' here and 'cup' in line 2"),
    ],
)
def test_an_error_in_a_csv_says_where_it_is(tmp_path, text, words):
    write_csv(tmp_path, text)
    with pytest.raises(BadRecording, match=words):
        read_recorded(tmp_path, "csv")


def test_features_that_are_called_a_little_like_other_columns_are_features(tmp_path):
    write_csv(tmp_path, "object,session,traction,shape1,sessions\nmug,1,2,3,4\n")
    assert read_recorded(tmp_path, "csv")[0].feature_names == ("traction", "shape1", "sessions")
    np.savez(tmp_path / "a.npz", features=np.ones((2, 1)), object=["a", "b"], sesion=[0, 1])
    with pytest.raises(BadRecording, match=r"a.npz has a column 'sesion'. Did you mean 'session'"):
        read_recorded(tmp_path / "a.npz", "npz")


def test_an_npz_gives_what_its_arrays_hold(tmp_path):
    arrays = {"features": np.ones((2, 3)), "object": np.array(["mug", "can"])}
    words = {"licence": "MIT", "provenance": "here", "feature_names": np.array(list("xyz"))}
    np.savez(tmp_path / "a.npz", **arrays, **words, extra=np.ones(2))
    touches, notes = read_recorded(tmp_path / "a.npz", "npz")
    assert (touches.licence, touches.provenance, touches.feature_names) == ("MIT", "here", ("x", "y", "z"))
    assert notes[-1] == "ignored arrays: 'extra'"


def test_an_npz_with_pickled_objects_runs_nothing(tmp_path):
    class Evil:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "ran"),)

    np.savez(tmp_path / "a.npz", features=np.ones((2, 1)), object=np.array([Evil(), Evil()], object))
    with pytest.raises(BadRecording, match="of plain arrays"):
        read_recorded(tmp_path / "a.npz", "npz")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("format_name", ["csv", "npz", "bts3"])
def test_a_folder_that_is_not_there_is_said(tmp_path, format_name):
    with pytest.raises(BadRecording, match="nowhere"):
        read_recorded(tmp_path / "nowhere", format_name)
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadRecording, match="empty"):
        read_recorded(tmp_path / "empty", format_name)
    with pytest.raises(BadRecording, match="known are csv"):
        read_recorded(tmp_path, "xlsx")


def damage(path, places):
    """Change some bytes of a file."""
    content = bytearray(path.read_bytes())
    for place in places:
        content[place] ^= 0xFF
    path.write_bytes(content)


def test_a_damaged_archive_is_said(tmp_path, rng):
    numbers = "".join(f"mug,{x}\n" for x in rng.normal(size=3000).tolist())
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(f"object,x\n{numbers}".encode(), mtime=0))
    damage(tmp_path / "a.csv.gz", (200, 201, 500))
    with pytest.raises(BadRecording, match=r"a\.csv\.gz cannot be read"):
        read_recorded(tmp_path, "csv")
    path = tmp_path / "a.npz"
    np.savez_compressed(path, features=rng.normal(size=(600, 3)), object=np.array(list("aab" * 200)))
    for first in range(200, 400, 20):
        damage(path, range(first, first + 20))
        with pytest.raises(BadRecording, match="of plain arrays"):
            read_recorded(path, "npz")


def test_an_npz_that_says_it_is_larger_than_memory_is_refused(tmp_path):
    header = io.BytesIO()
    fields = {"descr": "<f8", "fortran_order": False, "shape": (10**13, 1)}
    np.lib.format.write_array_header_1_0(header, fields)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("features.npy", header.getvalue() + bytes(64))
    with pytest.raises(BadRecording, match="of plain arrays"):
        read_recorded(tmp_path, "npz")


def test_an_npz_of_very_many_names_is_refused_before_they_are_read(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for number in range(20_000):
            archive.writestr(f"{number}.npy", b"")
    with pytest.raises(BadRecording, match=r"a\.npz cannot be read .* its list of names has \d+ bytes, and at most"):
        read_recorded(tmp_path, "npz")


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"session": np.arange("2024-01-01", "2024-01-07", dtype="datetime64[D]")}, "session is '2024-01-01'; it must"),
        ({"object": np.array([1.0, 1.0, 2.0, 2.0, np.nan, 3.0])}, "row 4 of .* names no object"),
        ({"features": np.full((6, 3), 1e200)}, "features of touch 0 .*hold 1e.200; .*up to 1e.100: use another unit"),
        ({"features": np.ones(6)}, r"features in .* must be numbers \(n, F\), or pictures .*, got float64 \(6,\)"),
        ({"object": np.array([b"\xff"] * 6)}, "cannot be read as .npz of plain arrays"),
    ],
)
def test_an_array_of_another_kind_in_an_npz_is_said(tmp_path, arrays, words):
    np.savez(tmp_path / "a.npz", **{"features": np.ones((6, 3)), "object": np.array(list("aabbcc")), **arrays})
    with pytest.raises(BadRecording, match=words):
        read_recorded(tmp_path, "npz")


def test_bts3_without_rows_is_refused(tmp_path):
    for pose in ("down", "45", "side"):
        (tmp_path / f"bts3v2_palm_{pose}.csv").write_text(",".join(["object", "slipped", *map(str, range(72))]) + "\n")
    with pytest.raises(BadRecording, match="no rows below their headers"):
        read_recorded(tmp_path, "bts3")


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_text_in_another_encoding_is_said(tmp_path, encoding):
    (tmp_path / "a.csv").write_text("object,x\ncafé,1\n", encoding=encoding)
    with pytest.raises(BadRecording, match=r"a\.csv is not text in UTF-8, save it as such"):
        read_recorded(tmp_path, "csv")


def test_columns_that_were_measured_where_nothing_was_touched_are_a_control_and_no_features(tmp_path):
    write_csv(tmp_path, "object,untouched:b,a,untouched: a,b\nmug,1,2,3,4\ncan,5,6,7,8\n")
    touches, _ = read_recorded(tmp_path, "csv")
    assert touches.feature_names == ("a", "b")
    assert touches.features.tolist() == [[2.0, 4.0], [6.0, 8.0]]
    assert touches.controls["untouched"].tolist() == [[3.0, 1.0], [7.0, 5.0]]  # in the order of the features
    np.savez(tmp_path / "a.npz", features=np.ones((2, 3)), object=np.array(["mug", "can"]), untouched=np.zeros((2, 1)))
    assert read_recorded(tmp_path / "a.npz", "npz")[0].controls["untouched"].shape == (2, 1)
    assert touches.only(touches.objects == 0).controls["untouched"].tolist() == [[7.0, 5.0]]


@pytest.mark.parametrize("shape", [(5, 6), (5, 6, 3), (70, 40), (33, 1)])
def test_pictures_are_rows_of_named_pixels_and_large_ones_are_averaged(shape, tmp_path, rng):
    pictures = rng.normal(size=(4, *shape))
    np.savez(tmp_path / "a.npz", features=pictures, object=np.array(list("aabb")))
    touches, notes = read_recorded(tmp_path / "a.npz", "npz")
    height, width, colours = min(shape[0], 32), min(shape[1], 32), (*shape, 1)[2]
    assert touches.features.shape == (4, height * width * colours)
    assert len(touches.feature_names) == touches.features.shape[1]
    assert any(f"are read as {height} x {width} pixels" in note for note in notes)
    if max(shape) <= 32:
        np.testing.assert_array_equal(touches.features, pictures.reshape(4, -1))
    if shape == (70, 40):
        np.testing.assert_allclose(touches.features[:, 0], pictures[:, :2, :1].mean(axis=(1, 2)))
    assert ("border pixels" in touches.controls) == (min(shape) > 2)


@pytest.mark.parametrize("form", ["csv", "npz"])
def test_an_action_of_several_columns_is_each_of_their_combinations(form, tmp_path):
    motion, force = ["rub", "press", "rub"], [1, 2, 2]
    write_csv(tmp_path, "object,motion,force,x\nmug,rub,1,5\nmug,press,2,6\nmug,rub,2,7\n")
    np.savez(tmp_path / "a.npz", features=np.ones((3, 1)), object=np.array(["mug"] * 3), motion=motion, force=force)
    touches, _ = read_recorded(tmp_path, form, ("motion", "force"))
    assert touches.action_names == ("press 2", "rub 1", "rub 2")
    assert touches.actions.tolist() == [1, 0, 2]
    assert touches.features.shape == (3, 1)
    with pytest.raises(BadRecording, match=r"--action speed: .* has no such column"):
        read_recorded(tmp_path, form, ("motion", "speed"))
    with pytest.raises(BadRecording, match="has its own actions"):
        read_recorded(BTS3, "bts3", ("motion",))
    if form == "csv":
        with pytest.raises(BadRecording, match=r"'motion' is 'rub', no number .*give --action motion"):
            read_recorded(tmp_path, form)


def test_an_npz_without_objects_says_what_it_has_and_what_is_needed(tmp_path):
    np.savez(tmp_path / "a.npz", X=np.ones((2, 1)), y=np.ones(2))
    with pytest.raises(BadRecording, match=r"no array 'features'; it has X, y\. Touches are features"):
        read_recorded(tmp_path, "npz")


def test_a_single_csv_file_is_read_and_an_archive_in_its_place_is_named(tmp_path):
    write_csv(tmp_path, "object,x\nmug,5\ncup,6\n")
    [path] = tmp_path.glob("*.csv")
    (tmp_path / "notes.txt").write_text("not read")
    found, notes = read_recorded(path, "csv")
    assert (len(found.features), any("notes.txt" in note for note in notes)) == (2, False)
    np.savez(tmp_path / "a.npz", x=np.ones(3))
    with pytest.raises(BadRecording, match="add --format npz"):
        read_recorded(tmp_path / "a.npz", "csv")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadRecording, match="header such as object,action,session"):
        read_recorded(tmp_path / "empty", "csv")
