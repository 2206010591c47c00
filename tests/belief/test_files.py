"""Files are written whole or not at all, and a disk that cannot take them is one clear error."""

import errno
import os
import socket
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from belief.errors import CannotWrite, CorruptFile, InvalidArgument
from belief.files import atomic_path, read_npz, require_regular_file, require_writable, write_text

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
NOT_ALLOWED = (errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO, errno.ESTALE, errno.ETIMEDOUT, errno.ENODEV)
STEPS = ("tempfile.mkstemp", "os.fsync", "pathlib.Path.replace", "pathlib.Path.mkdir")


def failing(number):
    def fail(*_, **__):
        raise OSError(number, os.strerror(number))

    return fail


@pytest.fixture
def old(tmp_path):
    """A file from before."""
    path = tmp_path / "folder" / "result.json"
    path.parent.mkdir()
    path.write_text("old")
    return path


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_an_archive_of_very_many_names_is_refused_before_they_are_read(tmp_path, compression, monkeypatch):
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", compression) as archive:
        for number in range(20_000):
            archive.writestr(f"{number}.npy", b"")
    monkeypatch.setattr(zipfile, "ZipInfo", None)  # which would be made of every name
    for source in (path, path.read_bytes()):
        with pytest.raises(zipfile.BadZipFile, match=r"list of names has \d+ bytes"):
            read_npz(source, 100)


def test_an_npz_with_two_arrays_of_one_name_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", x=np.ones(2))
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        archive.writestr("x.npy", archive.read("x.npy"))
    with pytest.raises(ValueError, match="two arrays of one name"):
        read_npz(tmp_path / "a.npz", 10_000)


@pytest.mark.parametrize("number", [*NO_ROOM, *NOT_ALLOWED], ids=os.strerror)
@pytest.mark.parametrize("step", STEPS)
def test_whichever_step_fails_the_error_names_path_cause_and_remedy_and_the_old_file_stays(
    old, monkeypatch, step, number
):
    monkeypatch.setattr(step, failing(number))
    with pytest.raises(CannotWrite) as caught:
        write_text(old, "new")
    monkeypatch.undo()
    words = str(caught.value)
    assert str(old) in words
    assert os.strerror(number) in words
    assert ("make room" if number in NO_ROOM else "--out") in words
    assert old.read_text() == "old"
    assert list(old.parent.iterdir()) == [old]


@pytest.mark.parametrize("number", [*NO_ROOM, *NOT_ALLOWED], ids=os.strerror)
def test_a_disk_that_fails_in_the_middle_of_the_content_is_the_same_error(old, number):
    def write_until_full():
        with atomic_path(old) as temporary:
            temporary.write_text("half of the n")
            failing(number)()

    with pytest.raises(CannotWrite, match=os.strerror(number)):
        write_until_full()
    assert old.read_text() == "old"


@pytest.mark.parametrize(
    "error",
    [OSError("10000 requested and 1008 written"), RuntimeError("I/O error: No space left on device (os error 28)")],
    ids=["numpy", "safetensors"],
)
def test_libraries_that_tell_a_full_disk_in_words_are_understood(old, error):
    with pytest.raises(CannotWrite, match="No space left on device"), atomic_path(old):
        raise error


@pytest.mark.parametrize(
    "error",
    [
        ValueError("a mistake"),
        OSError("no such format"),
        FileNotFoundError(errno.ENOENT, "No such file", "another"),
        PermissionError(errno.EACCES, "Permission denied", "another"),
        CorruptFile("another is damaged"),
    ],
    ids=repr,
)
def test_errors_of_another_kind_pass_as_they_are(old, error):
    with pytest.raises(type(error)) as caught, atomic_path(old):
        raise error
    assert caught.value is error
    assert list(old.parent.iterdir()) == [old]


@pytest.mark.parametrize("place", ["file/below", "file/deep/below", "dangling/below", "folder"])
def test_a_place_that_can_hold_no_file_is_named(tmp_path, place):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    (tmp_path / "folder").mkdir()
    with pytest.raises(CannotWrite, match="choose another --out") as caught:
        write_text(tmp_path / place, "new")
    assert str(tmp_path / place.split("/")[0]) in str(caught.value)
    assert (tmp_path / "file").read_text() == "mine"


def test_an_error_that_cannot_be_tidied_up_after_is_still_told(old, monkeypatch):
    monkeypatch.setattr("os.fsync", failing(errno.EROFS))
    monkeypatch.setattr("pathlib.Path.unlink", failing(errno.EROFS))
    with pytest.raises(CannotWrite, match="Read-only"):
        write_text(old, "new")


LIMITED = """
import resource, sys
from pathlib import Path

import numpy as np
from belief.files import atomic_path

resource.setrlimit(resource.RLIMIT_FSIZE, (8192, resource.RLIM_INFINITY))  # what lies beyond cannot be written
numbers = np.random.default_rng(0).random((100, 100))


def safetensors(path):
    from safetensors.numpy import save_file

    save_file({"numbers": numbers}, path)


def picture(path):
    from PIL import Image

    Image.fromarray((255 * numbers).astype(np.uint8)).resize((300, 300)).save(path)


writers = {
    "text": lambda path: path.write_text("x" * 10_000),
    "npy": lambda path: np.save(path, numbers),
    "npz": lambda path: np.savez(path, numbers=numbers),
    "safetensors": safetensors,
    "png": picture,
}
path = Path(sys.argv[1], "file." + sys.argv[2])
with atomic_path(path) as temporary:
    writers[sys.argv[2]](temporary)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="has no limit on the size of files")
@pytest.mark.parametrize("kind", ["text", "npy", "npz", "safetensors", "png"])
def test_a_write_that_the_system_really_refuses_is_the_clear_error_in_every_library(tmp_path, kind):
    found = subprocess.run([sys.executable, "-c", LIMITED, str(tmp_path), kind], capture_output=True, text=True)
    assert found.stderr.splitlines()[-1].startswith("belief.errors.CannotWrite: "), found.stderr
    assert "make room" in found.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", ["there", "there/not/yet", "."])
def test_asking_whether_a_folder_is_writable_leaves_nothing_behind(tmp_path, monkeypatch, folder):
    (tmp_path / "there").mkdir()
    monkeypatch.chdir(tmp_path)
    for asked in (tmp_path / folder, type(tmp_path)(folder)):
        require_writable(asked)
    assert list(tmp_path.rglob("*")) == [tmp_path / "there"]


@pytest.mark.parametrize("place", ["file", "file/below", "dangling"])
def test_a_folder_that_cannot_be_made_is_not_writable(tmp_path, place):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    with pytest.raises(CannotWrite, match=place.split("/")[0]):
        require_writable(tmp_path / place)


def test_a_full_disk_is_not_writable(tmp_path, monkeypatch):
    monkeypatch.setattr("os.fsync", failing(errno.ENOSPC))
    with pytest.raises(CannotWrite, match="make room"):
        require_writable(tmp_path)


def test_numbers_written_through_a_temporary_path_read_back(tmp_path):
    with atomic_path(tmp_path / "numbers.npy") as temporary:
        np.save(temporary, np.arange(3))
    assert np.load(tmp_path / "numbers.npy").tolist() == [0, 1, 2]


def test_a_folder_a_pipe_a_device_and_a_socket_are_refused_as_input(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the name of a socket has at most 107 bytes
    Path("folder").mkdir()
    os.mkfifo("pipe")
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("socket")
        for kind in ("folder", "pipe", "socket"):
            with pytest.raises(CorruptFile, match=f"{kind} is a {kind}, not a regular file"):
                require_regular_file(Path(kind))
    with pytest.raises(InvalidArgument, match="is a device"):
        require_regular_file(Path("/dev/zero"), InvalidArgument)


def test_a_file_a_link_to_one_and_a_missing_path_may_be_read(tmp_path):
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_text("")
    link.symlink_to(file)
    for path in (file, link, tmp_path / "missing", Path("\0")):
        assert require_regular_file(path) == path
