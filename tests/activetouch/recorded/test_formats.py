"""Formats of recorded touches: what is read, what is refused and said, and that nothing in a file runs or explodes."""

import bz2
import gzip
import io
import os
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from activetouch.errors import BadRecording
from activetouch.recorded import check_recorded, read_recorded
from activetouch.recorded.bounded import read_bounded
from activetouch.recorded.cy101 import BEHAVIOURS
from activetouch.recorded.dsa import read_dsa

BTS3 = Path(__file__).parents[2] / "fixtures" / "bts3"


def own_set(name):
    """The folder of a set that this project may not contain; the test is skipped without it."""
    folder = os.environ.get(f"ACTIVETOUCH_{name.upper()}")
    return Path(folder) if folder else pytest.skip(f"ACTIVETOUCH_{name.upper()} names no folder with {name}")


def test_bts3_has_its_objects_poses_and_licence():
    touches, _ = read_recorded(BTS3, "bts3")
    assert (touches.num_touches, len(touches.object_names), touches.num_actions) == (4682, 41, 3)
    assert touches.features.shape[1] == 72  # whether it slipped is not among them
    assert touches.licence == "MIT"
    assert "MIT License" in (BTS3 / "LICENSE").read_text()
    assert check_recorded(touches)[-1].startswith("there are no features from where nothing was touched")


def test_cy101_is_read_where_it_is():
    touches, notes = read_recorded(own_set("cy101"), "cy101")
    assert (touches.num_touches, len(touches.object_names)) == (4365, 97)
    assert any("hold_haptics.txt (smallstuffedanimal_otter_t3) is cut short: 63 values" in note for note in notes)
    assert len(touches.for_task("categories").label_names) == 20


def test_sdh2_is_read_where_it_is():
    touches, _ = read_recorded(own_set("sdh2"), "sdh2")
    assert touches.num_touches == 856
    assert len(touches.for_task("shapes").rows) == 429


def write_cy101(folder, change=None):
    """Three objects in three trials with made-up numbers; ``change`` edits the lines of a file."""
    rng = np.random.default_rng(0)
    for behaviour in BEHAVIOURS:
        for modality, width in (("haptics", 70), ("vibro", 100)):
            names = [f"{thing}_t{trial}" for thing in ("ball_a", "can_b", "no_object") for trial in (1, 2, 3)]
            lines = [",".join([name, *map(str, rng.normal(size=width))]) for name in names]
            path = folder / f"{behaviour}_{modality}.txt"
            path.write_text("\n".join(lines if change is None else change(path.name, lines)))


def test_a_value_that_is_not_finite_leaves_its_object_out(tmp_path):
    def change(name, lines):
        broken = lines[0].replace(",", ",nan,", 1).rsplit(",", 1)[0]
        return [broken, *lines[1:]] if name == "tap_vibro.txt" else lines

    write_cy101(tmp_path, change)
    touches, notes = read_recorded(tmp_path, "cy101")
    assert touches.object_names == ("can_b",)
    assert "line 1 of tap_vibro.txt (ball_a_t1) holds a value that is not finite" in notes[1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda name, lines: [*lines, lines[0]], "two lines for ball_a_t1"),
        (lambda name, lines: ["ball," + lines[0], *lines[1:]], "must begin with OBJECT_tN"),
        (lambda name, lines: [lines[0] + "x", *lines[1:]], "not a number"),
    ],
)
def test_what_is_no_cy101_is_refused(tmp_path, change, words):
    write_cy101(tmp_path, change)
    with pytest.raises(BadRecording, match=words):
        read_recorded(tmp_path, "cy101")


def dsa(frames, head=""):
    """A file of two pads of 1 × 2 and 2 × 1 cells."""
    pads = "".join(f"<cells_x>{x}</cells_x><cells_y>{y}</cells_y>" for x, y in ((2, 1), (1, 2)))
    data = "".join(f"<frame_data>{np.array(row, '>f4').tobytes().hex()}</frame_data>" for row in frames)
    return bz2.compress(f"<?xml version='1.0'?>{head}<root>{pads}{data}</root>".encode())


def test_runs_of_zeros_in_a_pressure_file_are_spread(tmp_path):
    (tmp_path / "a.dsa").write_bytes(dsa([[5.0, -2.0, 7.0], [-4.0]]))
    film = read_dsa(tmp_path / "a.dsa")
    assert film.frames.tolist() == [[5.0, 0.0, 0.0, 7.0], [0.0] * 4]
    assert [pad.shape for pad in film.pads(film.frames[0])] == [(1, 2), (2, 1)]


@pytest.mark.parametrize("top", [".", "grasps"])
def test_grasps_are_read_from_folders_of_objects_in_the_order_of_their_frames(top, tmp_path):
    for name, first, frame in (
        ("tennis_ball", 120, [4.0, -3.0]),
        ("tennis_ball", 9, [1.0, -3.0]),
        ("mug", 3, [-3.0, 2.0]),
    ):
        (tmp_path / top / name).mkdir(parents=True, exist_ok=True)
        (tmp_path / top / name / f"grasp_{first:06d}-{first + 50}.dsa").write_bytes(dsa([frame]))
    touches, notes = read_recorded(tmp_path, "sdh2")
    assert notes == ("60 features without names",)
    assert touches.object_names == ("mug", "tennis_ball")
    assert touches.labels["shapes"] == ("", "sphere")
    assert touches.objects.tolist() == [0, 1, 1]
    assert touches.sessions.tolist() == [0, 0, 1]
    assert touches.controls["scalar features only"].tolist() == [[2.0, 2.0, 1.0], [1.0, 1.0, 1.0], [4.0, 4.0, 1.0]]
    narrow = "<cells_x>3</cells_x><cells_y>1</cells_y>"
    data = f"<frame_data>{np.array([-3.0], '>f4').tobytes().hex()}</frame_data>"
    (tmp_path / top / "mug" / "grasp_000099-120.dsa").write_bytes(bz2.compress(f"<root>{narrow}{data}</root>".encode()))
    with pytest.raises(BadRecording, match=r"grasp_000099-120\.dsa has pads \(\(1, 3\),\)"):
        read_recorded(tmp_path, "sdh2")


ENTITIES = "<!DOCTYPE r [<!ENTITY a 'x'><!ENTITY b '&a;&a;&a;&a;'>]>"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (dsa([[-4.0]], ENTITIES), "document type or entities"),
        (dsa([[-5.0]]), "the pads have 4 cells"),
        (dsa([[np.nan]]), "not finite"),
        (dsa([[-1e30]]), "the pads have 4 cells"),
        (dsa([]), "1 to 10000 frames"),
        (bz2.compress(b"<root><frame_data>00</frame_data></root>"), "pads with"),
        (bz2.compress(b"<root><cells_y>2"), "cut short"),
        (dsa([[-4.0]])[:-9], "cannot be read"),
        (b"<root/>", "cannot be read"),
        (bz2.compress(bytes(17 * 2**20)), "more than"),
    ],
)
def test_hostile_pressure_files_are_refused(tmp_path, content, words):
    (tmp_path / "a.dsa").write_bytes(content)
    with pytest.raises(BadRecording, match=words):
        read_dsa(tmp_path / "a.dsa")


def test_a_bomb_is_not_unpacked(tmp_path):
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(bytes(2**20)))
    with pytest.raises(BadRecording, match="more than 1000 bytes"):
        read_bounded(tmp_path / "a.csv.gz", most=1000)


HEADER = "object,action,session,category,untouched:a,x,y\n"


def write_csv(folder, text, name="touches.csv"):
    (folder / name).write_text(text)


def test_a_csv_gives_objects_actions_sessions_and_controls(tmp_path):
    write_csv(tmp_path, HEADER + "mug,press,1,cup,0,1,2\nmug,rub,1,cup,0,3,4\n")
    write_csv(tmp_path, HEADER + "can,press,2,tin,0.5,5,6\n", "more.csv")
    touches, _ = read_recorded(str(tmp_path), "csv")
    assert touches.object_names == ("can", "mug")
    assert touches.action_names == ("press", "rub")
    assert touches.tasks == ("objects", "categories")
    assert touches.features.tolist() == [[5.0, 6.0], [1.0, 2.0], [3.0, 4.0]]
    assert touches.controls["features where nothing was touched"].tolist() == [[0.5], [0.0], [0.0]]
    assert touches.sessions.tolist() == [2, 1, 1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "must name the columns"),
        ("thing,x\nmug,1\n", "with 'object' among them"),
        ("object;x\nmug;0,5\n", "separated by commas, .*'object;x'"),
        (",object,x\n0,mug,1\n1,mug,2\n", r"column 1 of .*touches.csv has no name.*to_csv\(index=False\)"),
        ('object,x\nmug,"0,5"\n', "'0,5', no number .decimals have a point"),
        ("object,x\nmug\n", "line 2 of .* has 1 cells, the header has 2"),
        ("object,x\nmug,hot\n", "line 2 .*'x' is 'hot'"),
        ("object,x\nmug,1\n,1\n", "line 3 of .*touches.csv names no object"),
        ("object,session,x\nmug,1,1\nmug,soon,1\n", "line 3 of .*: the session is 'soon'; it must be a whole number"),
        ("object,x,pressure\nmug,1,1\n\nmug,2,inf\n", "line 4 .*'pressure' is 'inf', not finite"),
        ("object,category,x\nmug,cup,1\nmug,tin,1\n", "line 3 .*two of category: 'tin' here and 'cup' in line 2"),
    ],
)
def test_an_error_in_a_csv_says_where_it_is(tmp_path, text, words):
    write_csv(tmp_path, text)
    with pytest.raises(BadRecording, match=words):
        read_recorded(tmp_path, "csv")


def test_an_npz_gives_what_its_arrays_hold(tmp_path):
    arrays = {"features": np.ones((2, 3)), "object": np.array(["mug", "can"]), "untouched": np.zeros((2, 1))}
    words = {"licence": "MIT", "provenance": "here", "feature_names": np.array(list("xyz"))}
    np.savez(tmp_path / "a.npz", **arrays, **words, **{"control:own": np.ones((2, 2))})
    touches, _ = read_recorded(tmp_path / "a.npz", "npz")
    assert (touches.licence, touches.provenance, touches.feature_names) == ("MIT", "here", ("x", "y", "z"))
    assert set(touches.controls) == {"scalar features only", "own", "features where nothing was touched"}


def test_an_npz_with_pickled_objects_runs_nothing(tmp_path):
    class Evil:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "ran"),)

    np.savez(tmp_path / "a.npz", features=np.ones((2, 1)), object=np.array([Evil(), Evil()], object))
    with pytest.raises(BadRecording, match="of plain arrays"):
        read_recorded(tmp_path / "a.npz", "npz")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("format_name", ["cy101", "sdh2", "bts3", "npz", "csv"])
def test_a_folder_that_is_not_there_is_said(tmp_path, format_name):
    with pytest.raises(BadRecording, match="nowhere"):
        read_recorded(tmp_path / "nowhere", format_name)
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadRecording, match="empty"):
        read_recorded(tmp_path / "empty", format_name)
    with pytest.raises(BadRecording, match="known are cy101"):
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


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"session": np.arange("2024-01-01", "2024-01-07", dtype="datetime64[D]")}, "session is '2024-01-01'; it must"),
        ({"object": np.array([1.0, 1.0, 2.0, 2.0, np.nan, 3.0])}, "row 4 of .* names no object"),
        ({"features": np.full((6, 3), 1e200)}, "features of touch 0 .*hold 1e.200; .*up to 1e.100: use another unit"),
        ({"untouched": np.ones(6)}, r"untouched in .* must be numbers \(n, C\), got float64 \(6,\)"),
        ({"control:own": np.ones((5, 1))}, r"the control 'own' must be \(6, C\)"),
        ({"object": np.array([b"\xff"] * 6)}, "cannot be read as .npz of plain arrays"),
    ],
)
def test_an_array_of_another_kind_in_an_npz_is_said(tmp_path, arrays, words):
    np.savez(tmp_path / "a.npz", **{"features": np.ones((6, 3)), "object": np.array(list("aabbcc")), **arrays})
    with pytest.raises(BadRecording, match=words):
        read_recorded(tmp_path, "npz")


def test_bts3_without_rows_is_refused(tmp_path):
    for pose in ("down", "45", "side"):
        (tmp_path / f"bts3v2_palm_{pose}.csv").write_text(",".join(map(str, range(74))) + "\n")
    with pytest.raises(BadRecording, match="no rows below their headers"):
        read_recorded(tmp_path, "bts3")


def test_a_fraction_of_zeros_in_a_dsa_is_refused(tmp_path):
    numbers = struct.pack(">2f", -1.5, -2.5).hex()
    text = f"<r><cells_y>2</cells_y><cells_x>2</cells_x><frame_data>{numbers}</frame_data></r>"
    (tmp_path / "a.dsa").write_bytes(bz2.compress(text.encode()))
    with pytest.raises(BadRecording, match="zeros that is not whole"):
        read_dsa(tmp_path / "a.dsa")


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_text_in_another_encoding_is_said(tmp_path, encoding):
    (tmp_path / "a.csv").write_text("object,x\ncafé,1\n", encoding=encoding)
    with pytest.raises(BadRecording, match=r"a\.csv is not text in UTF-8, save it as such"):
        read_recorded(tmp_path, "csv")
