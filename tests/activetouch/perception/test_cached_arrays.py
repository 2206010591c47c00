"""Arrays of the cache: computed once, computed again where the file is damaged, and without a cache each time."""

import os
import subprocess
import sys

import numpy as np
import pytest

from activetouch.perception import cached_arrays
from activetouch.perception.cached_arrays import announced, cached_array, counted


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("ACTIVETOUCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


class Computed:
    """Counts how often it is asked."""

    def __init__(self, value=1.1):
        self.value, self.times = value, 0

    def __call__(self):
        self.times += 1
        return np.full((2, 3), self.value, np.float32)


def test_an_array_is_computed_once_and_is_the_same_from_the_file(cache):
    make = Computed()
    first, second = cached_array({"of": 1}, make), cached_array({"of": 1}, make)
    assert make.times == 1
    assert np.array_equal(first, second)
    assert first.dtype == second.dtype == np.float32
    assert len(list(cache.iterdir())) == 1


def test_an_array_of_other_height_maps_is_not_read(cache, monkeypatch):
    make = Computed()
    cached_array({"of": 1}, make)
    monkeypatch.setattr(cached_arrays, "_GEOMETRY", 1)
    cached_array({"of": 1}, make)
    assert make.times == 2


@pytest.mark.parametrize("damage", [b"", b"no tensors", None])
def test_a_damaged_file_is_computed_again_and_mended(cache, damage):
    make = Computed()
    cached_array({}, make)
    (path,) = cache.iterdir()
    content = path.read_bytes()
    path.write_bytes(content[:-3] + b"xyz" if damage is None else damage)
    assert cached_array({}, make)[0, 0] == np.float16(1.1)
    assert make.times == 2
    assert path.read_bytes() == content


def test_what_is_announced_says_how_much_is_done(cache, capfd, monkeypatch):
    monkeypatch.setattr(cached_arrays, "_EVERY", (-1.0, -1.0))

    def make():
        return np.array([float(item) for item in counted(range(3), "objects")], np.float32)

    cached_array({"of": 1}, make)  # nothing was announced
    assert capfd.readouterr().err == ""
    with announced("preparing"):
        assert cached_array({"of": 2}, make).tolist() == [0.0, 1.0, 2.0]
        cached_array({"of": 2}, make)
    lines = capfd.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == ["preparing", *[f"objects: {n}/3" for n in (1, 2, 3)]]


def test_files_that_were_exchanged_are_computed_again(cache):
    makes = {name: Computed(value) for name, value in {"one": 1.0, "other": 2.0}.items()}
    for name, make in makes.items():
        cached_array({"of": name}, make)
    first, second = cache.iterdir()
    contents = first.read_bytes(), second.read_bytes()
    first.write_bytes(contents[1])
    second.write_bytes(contents[0])
    for name, make in makes.items():
        assert cached_array({"of": name}, make)[0, 0] == make.value
        assert make.times == 2
    assert (first.read_bytes(), second.read_bytes()) == contents


def test_what_is_computed_is_announced_once_and_what_is_in_the_cache_is_not(cache, capsys):
    for number in (1, 2):
        with announced("this takes a minute"):
            with announced("this is a part"):
                cached_array({"of": 0}, Computed())
            for each in range(3):
                cached_array({"of": each}, Computed())
        assert capsys.readouterr() == ("", "this is a part\nthis takes a minute\n" if number == 1 else "")
    cached_array({"of": 3}, Computed())
    assert capsys.readouterr() == ("", "")


def test_without_a_folder_that_can_be_written_it_is_computed_each_time(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ACTIVETOUCH_CACHE", str(tmp_path / "file" / "cache"))
    make = Computed()
    found = [cached_array({}, make) for _ in range(2)]
    assert make.times == 2
    assert np.array_equal(*found)


def test_processes_that_compute_the_same_array_leave_one_whole_file(cache):
    code = (
        "import numpy as np; from activetouch.perception.cached_arrays import cached_array\n"
        "for n in range(5): print(cached_array({'n': n}, lambda: np.full(9, n, np.float32)).sum())"
    )
    run = [sys.executable, "-c", code]
    processes = [subprocess.Popen(run, stdout=subprocess.PIPE, text=True, env=dict(os.environ)) for _ in range(2)]
    assert [process.communicate()[0].split() for process in processes] == [["0.0", "9.0", "18.0", "27.0", "36.0"]] * 2
    assert len(list(cache.iterdir())) == 5
