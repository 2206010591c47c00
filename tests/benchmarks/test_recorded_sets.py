"""Readers of public sets of recorded touches: what is read, what is refused, and that nothing in a file runs."""

import bz2
import os
import struct
from pathlib import Path

import numpy as np
import pytest

from activetouch.errors import BadRecording
from activetouch.recorded import read_recorded
from benchmarks.recorded_sets.cy101 import BEHAVIOURS, read_cy101
from benchmarks.recorded_sets.dsa import read_dsa
from benchmarks.recorded_sets.sdh2 import read_sdh2
from benchmarks.recorded_sets.to_npz import write_npz


def own_set(name):
    """The folder of a set that this project may not contain; the test is skipped without it."""
    folder = os.environ.get(f"ACTIVETOUCH_{name.upper()}")
    return Path(folder) if folder else pytest.skip(f"ACTIVETOUCH_{name.upper()} names no folder with {name}")


def test_cy101_is_read_where_it_is():
    touches, notes = read_cy101(own_set("cy101"))
    assert (touches.num_touches, len(touches.object_names)) == (4365, 97)
    assert any("hold_haptics.txt (smallstuffedanimal_otter_t3) is cut short: 63 values" in note for note in notes)


def test_sdh2_is_read_where_it_is():
    touches, _ = read_sdh2(own_set("sdh2"))
    assert touches.num_touches == 856


def write_cy101(folder, change=None):
    """Three objects in three trials with made-up numbers; ``change`` edits the lines of a file."""
    rng = np.random.default_rng(0)
    for behaviour in BEHAVIOURS:
        for modality, width in (("haptics", 70), ("vibro", 100)):
            names = [f"{thing}_t{trial}" for thing in ("ball_a", "can_b", "no_object") for trial in (1, 2, 3)]
            lines = [",".join([name, *map(str, rng.normal(size=width))]) for name in names]
            path = folder / f"{behaviour}_{modality}.txt"
            path.write_text("\n".join(lines if change is None else change(path.name, lines)))


def test_a_line_that_is_cut_short_is_said_and_its_object_left_out(tmp_path):
    def change(name, lines):
        return [lines[0][:300], *lines[1:]] if name == "hold_haptics.txt" else lines

    write_cy101(tmp_path, change)
    touches, notes = read_cy101(tmp_path)
    assert touches.object_names == ("can_b",)
    assert "line 1 of hold_haptics.txt (ball_a_t1) is cut short" in notes[0]
    assert "ball_a" in notes[1]
    assert notes[2].startswith("no_object, behaviours in the air")


def test_a_value_that_is_not_finite_leaves_its_object_out(tmp_path):
    def change(name, lines):
        broken = lines[0].replace(",", ",nan,", 1).rsplit(",", 1)[0]
        return [broken, *lines[1:]] if name == "tap_vibro.txt" else lines

    write_cy101(tmp_path, change)
    touches, notes = read_cy101(tmp_path)
    assert touches.object_names == ("can_b",)
    assert "line 1 of tap_vibro.txt (ball_a_t1) holds a value that is not finite" in notes[0]


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
        read_cy101(tmp_path)


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
    touches, notes = read_sdh2(tmp_path)
    assert notes == ()
    assert touches.object_names == ("mug", "tennis_ball")
    assert touches.objects.tolist() == [0, 1, 1]
    assert touches.sessions.tolist() == [0, 0, 1]
    narrow = "<cells_x>3</cells_x><cells_y>1</cells_y>"
    data = f"<frame_data>{np.array([-3.0], '>f4').tobytes().hex()}</frame_data>"
    (tmp_path / top / "mug" / "grasp_000099-120.dsa").write_bytes(bz2.compress(f"<root>{narrow}{data}</root>".encode()))
    with pytest.raises(BadRecording, match=r"grasp_000099-120\.dsa has pads \(\(1, 3\),\)"):
        read_sdh2(tmp_path)


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


def test_a_fraction_of_zeros_in_a_dsa_is_refused(tmp_path):
    numbers = struct.pack(">2f", -1.5, -2.5).hex()
    text = f"<r><cells_y>2</cells_y><cells_x>2</cells_x><frame_data>{numbers}</frame_data></r>"
    (tmp_path / "a.dsa").write_bytes(bz2.compress(text.encode()))
    with pytest.raises(BadRecording, match="zeros that is not whole"):
        read_dsa(tmp_path / "a.dsa")


def test_a_set_is_the_same_after_it_was_written_as_npz(tmp_path):
    write_cy101(tmp_path)
    touches, _ = read_cy101(tmp_path)
    write_npz(touches, tmp_path / "cy101.npz")
    again, _ = read_recorded(tmp_path / "cy101.npz", "npz")
    for name in ("features", "actions", "objects", "sessions"):
        np.testing.assert_array_equal(getattr(again, name), getattr(touches, name))
    for name in ("action_names", "object_names", "provenance", "licence", "feature_names"):
        assert getattr(again, name) == getattr(touches, name)
