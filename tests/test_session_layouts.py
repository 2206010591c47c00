"""Touches as LeRobot datasets and MCAP files: bit-equal round trips, and files that other packages open."""

import base64
import json
import re
import runpy
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from activetouch import SCENES
from activetouch.errors import BadRecording
from belief import SearchProblem
from belief.errors import CannotWrite
from belief.synthetic import random_model
from planners import Session, make_decider

pd, pq = pytest.importorskip("pandas"), pytest.importorskip("pyarrow.parquet")
make_reader, Writer = pytest.importorskip("mcap.reader").make_reader, pytest.importorskip("mcap.writer").Writer

FOLDER = Path(__file__).parent.parent / "examples" / "session_layouts"
sys.path.append(str(FOLDER))  # as a script in the folder has it
try:
    from lerobot_dataset import read_lerobot, write_lerobot
    from mcap_file import read_mcap, write_mcap
    from session_touches import SessionTouches, TaxelLayout
finally:
    sys.path.remove(str(FOLDER))


def made(dtype="uint8", shape=(4, 4), seed=0):
    """Seven touches of two sessions, one a miss, at times that no grid has."""
    rng, n = np.random.default_rng(seed), 7
    images = rng.integers(0, 256, (n, *shape)).astype(dtype)
    if images.dtype.kind == "f":
        images += rng.normal(size=images.shape).astype(dtype)
    return SessionTouches(
        images,
        1.7e9 + np.cumsum(rng.exponential(7.0, n)),
        np.arange(n) % 3,
        ("front", "side", "top"),
        sessions=[0, 0, 0, 1, 1, 1, 1],
        objects=[0, 0, 1, 0, 0, 1, 1],
        targets=("mug", "größte Dose"),
        shapes=("mug", "mug", "can", "", "", "", ""),
        forces=np.array([1.5, np.nan, np.nan, 0.1, 2.0, 1 / 3, 2.0]),
        layout=TaxelLayout(rng.normal(size=(np.prod(shape), 3)), 1e-3),
    )


def equal(one, other):
    """Whether touches are equal to the last bit."""
    values = [(getattr(one, field.name), getattr(other, field.name)) for field in fields(one) if field.name != "layout"]
    if one.layout is not None:
        values += [
            tuple(getattr(touches.layout, name) for touches in (one, other))
            for name in ("positions", "newtons_per_unit")
        ]
    return (one.layout is None) == (other.layout is None) and all(
        (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()) if isinstance(a, np.ndarray) else a == b
        for a, b in values
    )


ROUND_TRIPS = {"lerobot": (write_lerobot, read_lerobot), "mcap": (write_mcap, read_mcap)}


@pytest.mark.parametrize("name", ROUND_TRIPS)
@pytest.mark.parametrize(
    ("dtype", "shape"),
    [("uint8", (4, 4)), ("uint8", (3, 5, 3)), ("uint16", (2, 2)), ("float32", (6,)), ("float64", (1,))],
)
def test_what_is_read_is_what_was_written_to_the_last_bit(name, dtype, shape, tmp_path):
    write, read = ROUND_TRIPS[name]
    touches = made(dtype, shape)
    write(tmp_path / "file", touches)
    assert equal(read(tmp_path / "file"), touches)


@pytest.mark.parametrize("name", ROUND_TRIPS)
def test_one_touch_without_anything_known_comes_back(name, tmp_path):
    write, read = ROUND_TRIPS[name]
    touches = SessionTouches(np.zeros((1, 1), np.float64), [0.1], [0], ("press",))
    write(tmp_path / "file", touches)
    assert equal(read(tmp_path / "file"), touches)
    assert np.isnan(touches.forces[0])
    assert touches.newtons is None


def test_a_dataset_is_laid_out_as_lerobot_reads_it(tmp_path):
    touches = made()
    write_lerobot(tmp_path, touches)
    info = json.loads((tmp_path / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["total_episodes"], info["total_frames"], info["total_tasks"]) == (
        "v3.0",
        2,
        7,
        2,
    )
    path = tmp_path / info["data_path"].format(chunk_index=0, file_index=0)
    data = pq.read_table(path)
    assert set(data.column_names) == set(info["features"])
    assert info["features"]["observation.taxels"] == {"dtype": "uint8", "shape": [4, 4], "names": None}
    assert np.array_equal(np.array(data["observation.taxels"].to_pylist(), np.uint8), touches.images)
    assert data["observation.time"].to_pylist() == touches.times.tolist()
    assert data["frame_index"].to_pylist() == data["timestamp"].to_pylist() == [0, 1, 2, 0, 1, 2, 3]
    tasks = pd.read_parquet(tmp_path / "meta" / "tasks.parquet")
    assert [tasks.iloc[index].name for index in data["task_index"].to_pylist()][2:4] == ["find mug", "find größte Dose"]
    episodes = pd.read_parquet(tmp_path / "meta" / "episodes" / "chunk-000" / "file-000.parquet")
    assert episodes["dataset_from_index"].tolist() == [0, 3]
    assert episodes["dataset_to_index"].tolist() == [3, 7]
    stats = json.loads((tmp_path / "meta" / "stats.json").read_text())
    assert np.allclose(stats["observation.taxels"]["mean"], touches.images.mean(axis=0))
    assert (stats["observation.force"]["count"], stats["observation.force"]["max"]) == ([5], [2.0])
    with pytest.raises(CannotWrite, match="another folder"):
        write_lerobot(tmp_path, touches)


def test_an_mcap_file_has_newtons_and_metres_for_its_own_reader(tmp_path):
    touches = made()
    write_mcap(tmp_path / "touches.mcap", touches)
    with (tmp_path / "touches.mcap").open("rb") as file:
        messages = [
            (schema, channel.topic, message.log_time, json.loads(message.data))
            for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages()
        ]
    assert [topic for _, topic, _, _ in messages] == ["/layout", *["/touch"] * 7]
    assert {schema.encoding for schema, _, _, _ in messages} == {"jsonschema"}
    assert set(json.loads(messages[1][0].data)["properties"]) == set(messages[1][3])
    assert np.array_equal(messages[0][3]["positions"], touches.layout.positions)
    for (_, _, log_time, message), time, image in zip(messages[1:], touches.times, touches.images, strict=True):
        assert abs(log_time - time * 1e9) < 1e3
        assert message["newtons"] == (image.ravel() * 1e-3).tolist()


def test_the_newtons_of_a_scene_add_up_to_the_force_of_a_press(rng):
    scene = SCENES["gel"].scene
    layout = TaxelLayout.of(scene)
    edge = 2 * scene.pad.half_width
    assert np.allclose(np.ptp(layout.positions, axis=0), [0.0, *[edge * (1 - 1 / scene.image_shape[0])] * 2])
    pressed = scene.press(scene.sample_object("sphere", rng), 0, rng)
    touches = SessionTouches(pressed.image[None], [0.0], [0], ("front",), layout=layout)
    assert 1.0 < touches.newtons.sum() < 4.0
    assert TaxelLayout.of(SCENES["paper"].scene) is None


def test_a_dataset_of_somebody_else_needs_only_its_taxels(tmp_path):
    write_lerobot(tmp_path, made())
    (tmp_path / "meta" / "activetouch.json").unlink()
    read = read_lerobot(tmp_path)
    assert np.array_equal(read.images, made().images)
    assert read.times.tolist() == [0, 1, 2, 0, 1, 2, 3]
    assert (read.pose_labels, read.targets) == (("touch",), ("an object",) * 2)
    with pytest.raises(BadRecording, match=r"feature observation\.skin"):
        read_lerobot(tmp_path, "observation.skin")


def test_messages_of_somebody_else_need_only_newtons(tmp_path):
    with (tmp_path / "other.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/touch", "json", 0)
        for number in range(2):
            writer.add_message(channel, 10**9 * number, json.dumps({"newtons": [0.5, number]}).encode(), 0)
        writer.finish()
    read = read_mcap(tmp_path / "other.mcap")
    assert read.images.tolist() == [[0.5, 0.0], [0.5, 1.0]]
    assert read.times.tolist() == [0.0, 1.0]


def damaged(content, rng):
    """The content cut short, and with single bytes changed."""
    yield content[: len(content) // 2]
    yield b""
    for place in rng.integers(len(content), size=12):
        yield content[:place] + bytes([content[place] ^ 0x55]) + content[place + 1 :]


def test_damaged_files_are_refused_or_read_as_touches(tmp_path, rng):
    write_lerobot(tmp_path / "set", made())
    write_mcap(tmp_path / "file", made())
    files = [Path("file"), *(path.relative_to(tmp_path) for path in (tmp_path / "set").rglob("*") if path.is_file())]
    refused = 0
    for name in files:
        whole = (tmp_path / name).read_bytes()
        for content in damaged(whole, rng):
            (tmp_path / name).write_bytes(content)
            try:
                assert isinstance(read_lerobot(tmp_path / "set"), SessionTouches)
                assert isinstance(read_mcap(tmp_path / "file"), SessionTouches)
            except BadRecording:
                refused += 1
        (tmp_path / name).write_bytes(whole)
    assert refused > 20


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"images": np.zeros((7, 2, 2), np.int64)}, "uint8, uint16, float32, float64; got int64"),
        ({"images": np.zeros((0, 2), np.uint8)}, "at least one"),
        ({"times": np.zeros(6)}, r"times must be \(7,\)"),
        ({"times": [0, 1, np.nan, 3, 4, 5, 6]}, "times must be finite and ≥ 0; got nan for touch 2"),
        ({"poses": [0, 0, 0, 0, 0, 0, 3]}, r"poses must be in \[0, 3\); got 3 for touch 6"),
        ({"poses": [0, 0, 0, 0, 0, 0, 0.5]}, "poses must be of int64"),
        ({"sessions": [0, 0, 2, 2, 2, 2, 2]}, "sessions must be .*got 2 for touch 2"),
        ({"sessions": [1, 1, 1, 1, 1, 1, 1]}, "sessions must be .*got 1 for touch 0"),
        ({"shapes": ("mug",)}, "shapes must be 7 names"),
        ({"targets": ("mug",)}, "targets must be 2 names"),
        ({"layout": TaxelLayout(np.zeros((3, 3)), 1.0)}, r"positions of taxels must be .*\(16, 3\); got \(3, 3\)"),
    ],
)
def test_arrays_that_do_not_fit_are_named(change, said):
    with pytest.raises(BadRecording, match=said):
        replace(made(), **change)


@pytest.mark.parametrize(
    ("positions", "force"), [(np.full((16, 3), np.nan), 1.0), (np.zeros(3), 1.0), (np.zeros((16, 3)), 0)]
)
def test_a_layout_that_is_none_is_refused(positions, force):
    with pytest.raises(BadRecording, match=r"positions|newtons_per_unit"):
        replace(made(), layout=TaxelLayout(positions, force))


def test_an_image_that_is_python_is_not_run(tmp_path):
    with (tmp_path / "evil.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/touch", "json", 0)
        image = {"dtype": "object", "shape": [1], "base64": base64.b64encode(b"\x80\x04.").decode()}
        writer.add_message(channel, 0, json.dumps({"image": image}).encode(), 0)
        writer.finish()
    with pytest.raises(BadRecording, match="are no object"):
        read_mcap(tmp_path / "evil.mcap")


class _Reader:
    """Reads any image as a random touch."""

    identity = "0" * 64

    def __init__(self, model):
        self.model, self.rng = model, np.random.default_rng(1)

    def read(self, image, pose):
        return image, self.model.sample(0, [pose], self.rng)[0], None


@pytest.fixture
def log(tmp_path):
    """The log of a session of three touches, of which the second was taken back."""
    model = random_model(np.random.default_rng(0))
    problem = SearchProblem(model.shape_labels, ("front", "side", "top"), num_objects=4)
    decider = make_decider("fixed_poses", model.outcome_table())
    session = Session(problem, decider, "shape_1", model, reader=_Reader(model))
    session.save(tmp_path / "log.jsonl")
    for number in range(3):
        session.tell(image=np.full((2, 2), number, np.uint8))
        if number == 1:
            session.undo()
    session.close()
    return tmp_path / "log.jsonl"


@pytest.mark.parametrize(("script", "read"), [("lerobot_dataset", read_lerobot), ("mcap_file", read_mcap)])
def test_a_script_writes_the_touches_of_a_log_that_stand(script, read, log, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [script, str(tmp_path / "out"), str(log)])
    monkeypatch.syspath_prepend(FOLDER)
    runpy.run_path(str(FOLDER / f"{script}.py"), run_name="__main__")
    assert "wrote" in capsys.readouterr().out
    found = read(tmp_path / "out")
    assert (found.images[:, 0, 0].tolist(), found.targets, found.pose_labels[2]) == ([0, 2], ("shape_1",), "top")
    assert re.search(rf"^Run: python examples/session_layouts/{script}.py", (FOLDER / f"{script}.py").read_text(), re.M)


def test_logs_that_cannot_be_exported_are_refused(log):
    with pytest.raises(BadRecording, match=r"logs must be of one touch or more"):
        SessionTouches.of_logs([])
    log.write_text("{}")
    with pytest.raises(ValueError, match=r"log\.jsonl"):
        SessionTouches.of_logs([log])
